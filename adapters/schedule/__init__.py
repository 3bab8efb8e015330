"""A weekly schedule of values, such as set-points, written in the configuration."""
