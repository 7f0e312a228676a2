"""Live deformed surface of a thin shell in a robot hand, on Loop subdivision surfaces."""
