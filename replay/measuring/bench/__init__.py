"""The measurements of `make bench`, one module each; `python -m replay.measuring.bench` runs them."""
