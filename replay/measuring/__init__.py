"""Measuring from outside: speed, memory, load, soak, overload. For a checkout; no wheel carries it."""
