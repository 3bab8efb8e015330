"""Addresses of web servers, as people write them."""

from __future__ import annotations

from urllib.parse import urlsplit


def is_web_address(text: str) -> bool:
    """Whether something may be at the URL `text`: http or https with a host, a port if it names one, and no blanks."""
    try:
        parts = urlsplit(text)
        found = parts.scheme in ("http", "https") and bool(parts.hostname) and parts.port != 0
    except ValueError:
        return False
    return found and text.isprintable() and " " not in text
