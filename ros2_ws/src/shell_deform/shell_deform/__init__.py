"""Live deformed surface of a thin shell in a robot hand: geometrically nonlinear thin shells on Loop subdivision surfaces."""
