"""What the grasp packages repeat: clouds, parameters, shutdown, diagnostics, terminal text."""
