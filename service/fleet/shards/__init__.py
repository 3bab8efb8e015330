"""A shard: its lease, its zones, what it takes from the reader and tells the gateways, and who brought it down."""
