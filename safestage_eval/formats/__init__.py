"""Bytes to episodes and back: Parquet datasets and MCAP files (docs/traces.md)."""

from typing import TYPE_CHECKING, Any

from .contact_points import POINT as CONTACT_POINT
from .discover import discover, load
from .episode_ref import EpisodeRef, Format
from .event import Event
from .save import save

if TYPE_CHECKING:
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


def __getattr__(name: str) -> Any:
    """Import what writes and what validates on first use."""
    if name == "TraceWriter":
        from .trace_writer import TraceWriter

        return TraceWriter
    if name in ("validate", "validate_episode"):
        from . import validation

        return getattr(validation, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
