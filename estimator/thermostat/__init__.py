"""The thermostat of a zone: its law, learned from set-points, temperatures and heat, and simulations that run it."""
