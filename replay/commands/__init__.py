"""The commands that this package adds to `thermogate`, by the entry points `thermogate.commands`."""
