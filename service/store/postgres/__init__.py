"""The store of a fleet: journal and checkpoints of many machines in one PostgreSQL database, each write fenced."""
