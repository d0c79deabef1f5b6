"""Bind files that match no episode, or misspell the name of a role."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from safestage_eval.errors import InputError, did_you_mean
from safestage_eval.formats import EpisodeRef

if TYPE_CHECKING:
    from safestage_eval.rules import BindFile, RuleSet


def require_match(bind: BindFile | None, refs: Iterable[EpisodeRef]) -> None:
    """Raises InputError where a bind file matches none of the episodes."""
    if bind is None or not bind.path:
        return
    count = 0
    for ref in refs:
        if bind.speaks_of(ref.fields.get("task"), ref.episode_id):
            return
        count += 1
    raise InputError(
        bind.path, f"it matches none of the {count} episodes.",
        fix="name their tasks under [task.NAME], their ids under [episode.ID], or all under [every]",
    )  # fmt: skip


def misspelt_roles(bind: BindFile | None, rules: RuleSet) -> list[str]:
    """Warn about roles in a bind file that no rule has but that resemble a rule's role.

    A role without such a namesake is no mistake: rules that are not loaded may ask for it.
    """
    scoped = [*rules.scoped.values(), *rules.goals.values()]
    there = {role for item in scoped for role, _ in item.roles}
    warnings: dict[str, None] = {}
    every = {} if bind is None or bind.every is None else {"every": bind.every}
    for name, task in ({} if bind is None else {**every, **bind.tasks, **bind.episodes}).items():
        for role, _ in task.roles:
            meant = "" if role in there else did_you_mean(role, there, 0.8)
            if meant:
                warnings[f"{name}: no loaded rule has a role {role}: {meant}"] = None
    return [f"{bind.path}: {warning}" for warning in warnings] if bind is not None else []
