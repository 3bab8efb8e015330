"""The load generator of `make load-fleet`; `python -m replay.measuring.fleet` runs it."""
