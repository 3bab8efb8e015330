"""Forecasts of the weather: files, an address and Zenoh, each read anew as it changes."""
