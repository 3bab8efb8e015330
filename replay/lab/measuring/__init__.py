"""Measuring from outside: speed, memory, load, soak, overload."""
