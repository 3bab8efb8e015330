"""Zenoh: session, access control, subscriptions, and the source on top."""
