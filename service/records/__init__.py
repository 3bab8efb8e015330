"""What moves between the rooms: samples, updates, fans, history, status."""
