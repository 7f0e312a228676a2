"""Live 3-D page of a grasp in the browser."""
