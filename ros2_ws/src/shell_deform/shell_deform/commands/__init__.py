"""Console commands of shell_deform."""
