# SPDX-License-Identifier: Apache-2.0
"""Modulus, pressure and wall from force curves, squeezes and dents."""
