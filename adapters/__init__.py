"""The outside world as sources of readings. Knows no estimator and no daemon."""
