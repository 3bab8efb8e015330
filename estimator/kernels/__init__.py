"""Compiled code: vector lanes, algebra, random draws, the particle step. It knows no network, only arrays."""
