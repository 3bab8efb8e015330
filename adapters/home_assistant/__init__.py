"""The history of Home Assistant: its recorder's database."""
