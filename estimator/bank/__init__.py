"""A bank of estimators that trust different things: weights per horizon, coverage kept by feedback."""
