"""The paper's experiments: each a plan of runs, and a report of what came out (`thermogate experiment NAME`)."""
