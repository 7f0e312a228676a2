"""What answers one contact sample: fusion, the served surface, its states and figures."""
