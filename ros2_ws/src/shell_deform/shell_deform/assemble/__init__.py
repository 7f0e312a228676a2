# SPDX-License-Identifier: Apache-2.0
"""The undeformed shell at its quadrature points: energy, gradient, stiffness."""
