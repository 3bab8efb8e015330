"""What survives a power failure: journal, checkpoints, retention, backups."""
