"""What reaches the zones: sources at work, readings that clients post, and forecasts of the weather."""
