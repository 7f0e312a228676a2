"""Console commands of scan_compare."""
