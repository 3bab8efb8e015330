"""A shard: its lease, its zones, what it tells the gateways, and who brought it down."""
