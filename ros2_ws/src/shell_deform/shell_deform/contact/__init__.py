"""What pushes: loads, pins, and rigid pads in unilateral contact."""
