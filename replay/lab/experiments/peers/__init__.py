"""`peers`: measured buildings that others have fitted."""
