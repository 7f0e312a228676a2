"""Solvers: sparse factorisation, Newton, continuation, stability."""
