"""Mathematics only: networks, online estimators, offline fits. No I/O, clock, thread or logging."""
