"""Sparse symmetric LDL^T: orderings, symbolic analysis, fronts, substitution, borders."""
