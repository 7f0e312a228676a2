"""The undeformed shell at its quadrature points: energy, gradient, stiffness."""
