"""Deformed shells against 3-D scans: registration, distances, statistics, noise floor."""
