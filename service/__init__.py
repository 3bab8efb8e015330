"""The daemon, in rooms with one direction of import; `docs/architecture.md` has the map."""
