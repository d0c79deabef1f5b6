"""Signals: ``(T,)`` series with a unit, measured from an episode. No thresholds.

Every file here declares one signal, or a family of like ones, with ``@signal`` above the function that
measures it. All files are imported with the room, so a new file needs no entry in any list.
"""

from importlib import import_module
from pkgutil import iter_modules

from safestage_eval.evidence.declare import SIGNALS

for _file in iter_modules(__path__):
    import_module(f"{__name__}.{_file.name}")

__all__ = ["SIGNALS"]
