"""Telemetry that lies: what a sensor or a meter tells is held against what it told before."""
