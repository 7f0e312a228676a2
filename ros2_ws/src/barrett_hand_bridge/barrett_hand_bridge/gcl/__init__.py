"""Driver of the BH8-262 and other serial BarrettHands (Grasper Control Language, RS-232)."""
