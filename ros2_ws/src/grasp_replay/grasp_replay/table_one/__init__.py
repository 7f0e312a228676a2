# SPDX-License-Identifier: Apache-2.0
"""The published Table I, settled: what its forces and displacements say, and what they cannot."""
