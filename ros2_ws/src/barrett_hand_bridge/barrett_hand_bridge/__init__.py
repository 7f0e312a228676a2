# SPDX-License-Identifier: Apache-2.0
"""BarrettHand driver: strain-gauge finger forces, contact points, emulators of both hands."""
