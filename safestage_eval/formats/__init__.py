"""Bytes to episodes and back: Parquet datasets and MCAP files (docs/traces.md)."""

from .contact_points import POINT as CONTACT_POINT
from .discover import discover, load
from .episode_ref import EpisodeRef, Format
from .event import Event
from .save import save
from .validate import validate, validate_episode
from .writer import TraceWriter

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
