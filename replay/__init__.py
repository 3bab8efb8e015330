"""Recorded and simulated periods: replay, testbeds, scores, experiments, measuring."""
