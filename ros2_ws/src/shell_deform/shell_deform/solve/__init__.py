"""Solvers: Newton, continuation, stability, the paper's conjugate gradients."""
