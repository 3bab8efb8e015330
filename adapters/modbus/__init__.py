"""Modbus over TCP and RTU, read only: registers, requests, connection, polling."""
