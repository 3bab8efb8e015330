"""One zone: its telemetry aligned and accepted, its worker, its recovery."""
