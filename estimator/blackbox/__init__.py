"""Models that know nothing of heat: what a physical model has to beat, and leans on where its network misses a path."""
