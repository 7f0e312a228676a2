"""Console commands of barrett_hand_bridge."""
