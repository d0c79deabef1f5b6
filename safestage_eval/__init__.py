"""SafeStage's evaluator: traces in, verdicts out. Never imports MuJoCo.

In a notebook::

    import safestage_eval as sse

    episode = sse.load("rollout.mcap")
    episode.plot("clearance(target, protected)")
    scores = sse.score("traces/", rules="fsh", edge="3 cm")
    scores.findings
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from .version import __version__

if TYPE_CHECKING:
    from .api import Episode, Finding, Scores, load, score
    from .episode import Body, Cavity, Geom, Header, Joint, Mesh
    from .errors import InputError, RuleError, TraceError
    from .formats import TraceWriter, discover, save, validate
    from .metrics import aggregate, read_outcomes
    from .monitor import Monitor
    from .rules import load_rules

__all__ = [
    "Body",
    "Cavity",
    "Episode",
    "Finding",
    "Geom",
    "Header",
    "InputError",
    "Joint",
    "Mesh",
    "Monitor",
    "RuleError",
    "Scores",
    "TraceError",
    "TraceWriter",
    "__version__",
    "aggregate",
    "discover",
    "load",
    "load_rules",
    "read_outcomes",
    "save",
    "score",
    "validate",
]

_HOMES = {
    **dict.fromkeys(("Episode", "Finding", "Scores", "load", "score"), "api"),
    **dict.fromkeys(("Body", "Cavity", "Geom", "Header", "Joint", "Mesh"), "episode"),
    **dict.fromkeys(("InputError", "RuleError", "TraceError"), "errors"),
    **dict.fromkeys(("TraceWriter", "discover", "save", "validate"), "formats"),
    **dict.fromkeys(("aggregate", "read_outcomes"), "metrics"),
    "Monitor": "monitor",
    "load_rules": "rules",
}


def __getattr__(name: str) -> Any:
    """Public names are imported when first used: ``import safestage_eval`` itself costs nothing."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    import importlib

    return getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    """The public names, for completion."""
    return sorted({*globals(), *__all__})
