"""Whether the package ``simulate`` of this project, and MuJoCo, are installed."""

from __future__ import annotations

import importlib
import importlib.util

NAME = "simulate"
"""Never imported by name: the evaluator does without it."""


def why_not() -> str | None:
    """Steps that make the simulator usable; None if it already is. Does not import MuJoCo."""
    spec = importlib.util.find_spec(NAME)
    if spec is None:
        return "pip install 'safestage[simulate]'"
    if not getattr(importlib.import_module(NAME), "SAFESTAGE", False):
        return (
            f"another package named 'simulate' is in its place ({spec.origin}); uninstall it, "
            "then pip install --force-reinstall 'safestage[simulate]'"
        )
    if importlib.util.find_spec("mujoco") is None:
        return "MuJoCo is not installed: pip install 'safestage[simulate]'"
    return None
