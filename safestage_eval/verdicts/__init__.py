"""Verdicts: a rule set and an episode in, verdicts with their witnesses out."""

from typing import TYPE_CHECKING, Any

from .verdict import CostTotal, EpisodeResult, Verdict

if TYPE_CHECKING:
    from .judging import judge

__all__ = ["CostTotal", "EpisodeResult", "Verdict", "judge"]


def __getattr__(name: str) -> Any:
    """Import ``judge``, and with it everything that measures, on first use."""
    if name != "judge":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from .judging import judge

    return judge
