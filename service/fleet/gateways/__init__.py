"""A gateway: zones that are elsewhere, as REST sees them, and what clients post on its way to them."""
