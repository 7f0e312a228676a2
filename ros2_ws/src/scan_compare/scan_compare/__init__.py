"""Deformed shell surface against 3-D scans: registration, distances, statistics and their noise floor."""
