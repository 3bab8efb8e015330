"""A shard: its lease, its zones, what it tells the gateways, and which sample brought it down."""
