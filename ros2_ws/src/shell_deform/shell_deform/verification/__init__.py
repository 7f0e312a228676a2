"""Reference problems: ours beside published, analytic and independent values."""
