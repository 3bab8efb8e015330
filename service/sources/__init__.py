"""The kinds of source: their tables in the configuration, how each is built, checked and rebound."""
