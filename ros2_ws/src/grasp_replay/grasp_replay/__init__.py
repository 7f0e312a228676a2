"""Recorded grasps: record, check, repair, replay, and run the whole pipeline offline."""
