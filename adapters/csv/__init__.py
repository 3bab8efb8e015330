"""Recorded files: cells, times, tables, and the source that plays them."""
