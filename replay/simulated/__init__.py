"""Simulated buildings, weather and people, and the synthetic recordings made from them."""
