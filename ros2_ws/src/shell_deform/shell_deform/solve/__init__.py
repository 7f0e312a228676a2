# SPDX-License-Identifier: Apache-2.0
"""Solvers: Newton, continuation, stability, the paper's conjugate gradients."""
