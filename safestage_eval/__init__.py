"""SafeStage's evaluator: traces in, verdicts out. Never imports MuJoCo.

In a notebook::

    import safestage_eval as sse

    episode = sse.load("rollout.mcap")
    episode.signals("clearance(target, protected)").plot()
    sse.score("traces/", rules="fsh", edge="3 cm")
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from .version import __version__

__all__ = ["Episode", "InputError", "TraceWriter", "__version__", "load", "score"]

if TYPE_CHECKING:
    from .api import Episode, load, score
    from .errors import InputError
    from .formats import TraceWriter

_HOMES = {
    "Episode": "api",
    "load": "api",
    "score": "api",
    "InputError": "errors",
    "TraceWriter": "formats",
}


def __getattr__(name: str) -> Any:
    """Public names are imported when first used: ``import safestage_eval`` itself costs nothing."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    import importlib

    return getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)
