# SPDX-License-Identifier: Apache-2.0
"""Console commands of shell_deform.

Dense blocks here are small: more than one BLAS thread per process only spins.
"""

import os

os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
os.environ.setdefault('OMP_NUM_THREADS', '1')
