"""The measurements of `make bench`; `python -m replay.lab.measuring.bench` runs them."""
