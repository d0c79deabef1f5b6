"""Bytes to episodes and back: Parquet datasets and MCAP files (docs/traces.md)."""

from .contact_points import POINT as CONTACT_POINT
from .discover import discover, load
from .episode_ref import EpisodeRef, Format
from .event import Event
from .save import save
from .trace_writer import TraceWriter
from .validation import validate, validate_episode

__all__ = [
    "CONTACT_POINT",
    "EpisodeRef",
    "Event",
    "Format",
    "TraceWriter",
    "discover",
    "load",
    "save",
    "validate",
    "validate_episode",
]
