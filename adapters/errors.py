"""Errors of the adapters, one tree with one base."""


class SourceError(Exception):
    """Base of every error a source raises on purpose; its text is one sentence naming the place and the remedy."""


class SourceUnavailable(SourceError):
    """The source cannot be reached or read now; trying again later may help."""


class SourceConfigError(SourceError):
    """The source is described wrongly; trying again will not help."""
