"""`semi-synthetic`: a simulated building whose truth is known (5.1)."""
