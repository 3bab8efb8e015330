"""The load generator of `make load-fleet`; `python -m replay.lab.measuring.fleet` runs it."""
