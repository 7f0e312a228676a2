# SPDX-License-Identifier: Apache-2.0
"""Sparse symmetric LDL^T: orderings, symbolic analysis, fronts, substitution, borders."""
