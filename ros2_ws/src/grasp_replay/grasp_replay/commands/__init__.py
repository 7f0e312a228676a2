"""Console commands of grasp_replay."""
