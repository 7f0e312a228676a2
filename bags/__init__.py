"""Recorded experiments and what makes them: solid truth, scanner, recording."""
