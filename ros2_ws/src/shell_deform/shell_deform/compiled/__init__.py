# SPDX-License-Identifier: Apache-2.0
"""Where compiled kernels are kept, their types, and the first use that compiles them all."""
