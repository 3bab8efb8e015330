"""Experiments, each a plan of runs and a report of what came out; here are those on a recording of one's own."""
