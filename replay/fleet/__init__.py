"""The load generator of `make load-fleet`; `python -m replay.fleet` runs it."""
