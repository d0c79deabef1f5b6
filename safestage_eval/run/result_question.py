"""Everything a result depends on besides the trace and the code, as one text."""

from __future__ import annotations

from collections.abc import Mapping

from safestage_eval.formats import EpisodeRef
from safestage_eval.rules import BindFile, RuleSet


def result_question(
    ref: EpisodeRef,
    rules: RuleSet,
    overrides: Mapping[str, str] | None = None,
    bind: BindFile | None = None,
    *,
    assigned_only: bool = False,
    strict: bool = False,
) -> str:
    """The question that scoring an episode answers; of a bind file, what it says of the episode."""
    bound = None
    if bind is not None:
        task = bind.tasks.get(ref.fields.get("task") or "")
        own, bodies = bind.episodes.get(ref.episode_id), sorted(bind.bodies.items())
        bound = bind.path, bind.every, task, own, bodies, bind.command
    asked = sorted((overrides or {}).items()), bound, assigned_only, strict
    return f"result {rules.digest} {asked!r}"
