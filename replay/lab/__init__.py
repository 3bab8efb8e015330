"""The laboratory: the paper's experiments, and what measures this project. For a checkout; no wheel carries it."""
