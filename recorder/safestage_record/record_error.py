"""Errors that keep a rollout from being recorded."""

from __future__ import annotations


class RecordError(Exception):
    """A recording that cannot be made: what is wrong, what is allowed, how to fix it."""
