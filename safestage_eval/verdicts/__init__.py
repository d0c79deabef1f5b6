"""Verdicts: a rule set and an episode in, verdicts with their witnesses out."""

import sys
from types import ModuleType
from typing import TYPE_CHECKING, Any

from .verdict import CostTotal, EpisodeResult, Verdict

if TYPE_CHECKING:
    from .judge import judge

__all__ = ["CostTotal", "EpisodeResult", "Verdict", "judge"]


def __getattr__(name: str) -> Any:
    """What judges comes with all that measures, and is loaded when it is asked for."""
    if name != "judge":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from .judge import judge

    return judge


class _Verdicts(ModuleType):
    """In which ``judge`` is the function, also after its file was imported and would stand for it."""

    def __setattr__(self, name: str, value: Any) -> None:
        is_file = name == "judge" and isinstance(value, ModuleType)
        super().__setattr__(name, value.judge if is_file else value)


sys.modules[__name__].__class__ = _Verdicts
