"""Forecasts under a plan: one request, one grammar of plans and one engine, for REST, Zenoh, the page and notebooks."""
