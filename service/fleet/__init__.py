"""The zones of a site spread over a Ray cluster: shards run them as the daemon does, a steward sees that they live."""
