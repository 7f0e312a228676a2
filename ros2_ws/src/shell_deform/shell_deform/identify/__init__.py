"""Modulus, pressure and wall from force curves, squeezes and dents."""
