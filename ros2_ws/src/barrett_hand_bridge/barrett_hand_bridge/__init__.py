"""BarrettHand driver: strain-gauge finger forces, contact points, emulators of both hands."""
