"""Sockets, TLS and HTTP connections. It knows no route."""
