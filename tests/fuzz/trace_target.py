"""Judging a stored trace that was damaged, and comparing with what it was."""

from __future__ import annotations

from pathlib import Path
from random import Random

from outcome import Outcome, compared
from seeds import rules

from safestage_eval.errors import InputError
from safestage_eval.formats import discover, load, save, validate
from safestage_eval.rules import RuleSet
from safestage_eval.run.score_episode import score_episode
from safestage_eval.verdicts.problem import Problem

UNFORESEEN = ": cannot be judged: "
"""Of ``score_episode``, where no error of ours came up but some other one."""


def verdicts(path: Path, by: RuleSet | None = None) -> dict[str, str] | Outcome:
    """Rule → verdict of the only episode under a path, or what became of it."""
    refs = discover(path)
    if len(refs) != 1:
        return Outcome("problem", "", f"{len(refs)} episodes")
    result = score_episode(refs[0], by or rules())
    if isinstance(result, Problem):
        kind = "unforeseen" if UNFORESEEN in result.message else "problem"
        return Outcome(kind, "", result.message)
    return {verdict.rule: verdict.verdict for verdict in result.verdicts}


def judged(
    path: Path, truth: dict[str, str] | None, what: str, by: RuleSet | None = None
) -> Outcome:
    """What becomes of a damaged trace; without ``truth`` it may have become another, sound one."""
    try:
        found = verdicts(path, by)
    except InputError as error:
        return Outcome("problem", what, str(error))
    if isinstance(found, Outcome):
        return found._replace(what=what)
    return Outcome("read", what) if truth is None else compared(truth, found, what)


def used(rng: Random, path: Path, folder: Path) -> None:
    """The trace taken for other ends than scoring; raises what nobody foresaw."""
    try:
        validate(path)
        episode = load(path, checked=rng.random() < 0.5)
        save(episode, folder / rng.choice(("other", "other.mcap")))
    except InputError:
        pass
