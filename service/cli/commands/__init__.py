"""The commands, one file each. Every module here is a command: its `add_to` is called with what adds it."""
