"""The history of Home Assistant: its recorder's database, and the source that plays it."""
