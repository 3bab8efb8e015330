"""Fits to a whole recording: simulation in open loop and least squares."""
