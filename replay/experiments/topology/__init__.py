"""`topology`: which RC network to take (4.3.3)."""
