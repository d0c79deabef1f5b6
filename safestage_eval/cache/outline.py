"""What holds of an episode under all values of parameters, as JSON."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

from safestage_eval.rules import Binding
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.digest import parameters_read
from safestage_eval.verdicts import EpisodeResult
from safestage_eval.verdicts.judging import Judge

from .stored import plain

Setting = ast.Quantity | ast.Duration

ALIKE = "alike"
"""Name of what many episodes have in common, as one text, so that it is understood once."""

FIXED = frozenset({"contact_force"})
"""Parameters that are read besides by rules and goals."""


def outline_of(judge: Judge, binding: Binding, found: EpisodeResult) -> dict[str, Any] | None:
    """What holds of an episode under all values (JSON); None where too much depends on them.

    Args:
        judge: of the episode.
        binding: of the episode, without overrides.
        found: what it came to.
    """
    players = judge.players
    if found.costs or len(players) != len(found.verdicts):
        return None
    fixed = FIXED | parameters_read(binding.rules, binding.goal)
    usual, values = binding.params(None), judge.binding.params(None)
    if any(usual.get(name) != values.get(name) for name in fixed):
        return None
    alike = {
        "rules": [[code, who] for code, who in players.items()],
        "roles": dict(binding.roles),
        "assigned": list(binding.assigned),
        "family": binding.family,
        "provenance": dict(binding.provenance),
        "values": {name: written(value) for name, value in binding.values.items()},
        "fixed": sorted(fixed),
    }
    return {
        "result": plain(found) | {"verdicts": [], "costs": []},
        "success": [judge.success_frame, judge.success_known, judge.about_success],
        ALIKE: json.dumps(alike, separators=(",", ":")),
    }


def written(value: Setting) -> list[Any]:
    """A value of a parameter as JSON."""
    if isinstance(value, ast.Quantity):
        return [value.value, value.dimension, value.text]
    return [value.amount, value.frames, value.least, value.text]


def read(stored: Sequence[Any]) -> Setting:
    """A value of a parameter from JSON."""
    return ast.Quantity(*stored) if len(stored) == 3 else ast.Duration(*stored)
