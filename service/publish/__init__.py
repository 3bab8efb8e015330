"""What leaves the daemon: payloads, rendered once, and the sinks that they go to."""
