"""The version, as traces state it."""

__version__ = "0.1.0"
