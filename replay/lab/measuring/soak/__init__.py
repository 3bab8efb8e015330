"""The soak of `make soak`: the real daemon for simulated days, restless clients and faults."""
