"""Forecasts held to what came: those that wait for their time, and scores of those whose time has come."""
