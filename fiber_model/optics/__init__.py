"""Light through one fiber by physics: the ground truth that the three lobes are fitted to."""
