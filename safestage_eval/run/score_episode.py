"""Open and judge one episode: the pure function that every process of a run calls."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from safestage_eval._process.within import within_limits
from safestage_eval.episode.contradiction import ContradictionError
from safestage_eval.errors import InputError, TraceError, shortened, visible
from safestage_eval.formats import EpisodeRef
from safestage_eval.verdicts.problem import Problem

if TYPE_CHECKING:
    from safestage_eval.episode import Episode
    from safestage_eval.rules import BindFile, RuleSet
    from safestage_eval.verdicts import EpisodeResult


Look = Callable[["Episode", "RuleSet", "BindFile | None"], dict[str, Any]]
"""Finds more in an episode that was judged, as JSON values: ``EpisodeResult.audit``."""


_OTHER_CONTENT = "the content hash that the file states is not that of its content: it was changed"


def score_episode(
    ref: EpisodeRef,
    rules: RuleSet,
    overrides: Mapping[str, str] | None = None,
    bind: BindFile | None = None,
    *,
    assigned_only: bool = False,
    strict: bool = False,
    look: Look | None = None,
) -> EpisodeResult | Problem:
    """Open and judge one episode; whatever is wrong with it becomes a problem, not an exception."""
    try:
        with within_limits(ref.shown):
            return _scored(
                ref, rules, overrides, bind, assigned_only=assigned_only, strict=strict, look=look,
            )  # fmt: skip
    except InputError as error:
        return Problem(ref.shown, str(error), isinstance(error, ContradictionError))
    except Exception as error:  # noqa: BLE001 — one episode must not cost the others
        return Problem(ref.shown, f"{ref.shown}: cannot be judged: {_told(error)}")


def _scored(
    ref: EpisodeRef,
    rules: RuleSet,
    overrides: Mapping[str, str] | None,
    bind: BindFile | None,
    *,
    assigned_only: bool,
    strict: bool,
    look: Look | None,
) -> EpisodeResult:
    """The result. Raises InputError."""
    from safestage_eval.verdicts import judge

    if ref.problem is not None:
        raise ref.problem

    episode = ref.open()
    differs = ref.content_hash not in (None, episode.content_hash)
    if differs and strict:
        raise TraceError(ref.shown, _OTHER_CONTENT, fix="restore the file, or record again")
    result = judge(
        episode, rules, overrides=overrides, bind=bind, assigned_only=assigned_only, strict=strict
    )
    if differs:
        result = replace(result, notes=(*result.notes, _OTHER_CONTENT))
    return result if look is None else replace(result, audit=look(episode, rules, bind))


def _told(error: Exception) -> str:
    """An unforeseen error in one line, with the place in the code where it came up."""
    place, trace = "", error.__traceback__
    while trace is not None:
        code = trace.tb_frame.f_code
        place, trace = f"{Path(code.co_filename).name}:{trace.tb_lineno}", trace.tb_next
    return f"{type(error).__name__}: {visible(shortened(str(error)))} ({place})"
