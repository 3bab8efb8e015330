"""Readings that clients post: what a post says, and the source that turns it into readings."""
