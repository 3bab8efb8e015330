"""Recordings through the daemon's worker, and what loggers make of a building."""
