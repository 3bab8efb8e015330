"""The measurements of `make bench`, one module each; `python -m replay.lab.measuring.bench` runs them."""
