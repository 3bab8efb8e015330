"""Recordings of zones: read through their own alignment, and looked at before anything is learned from them."""
