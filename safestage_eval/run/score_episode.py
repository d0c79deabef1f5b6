"""Open and judge one episode: the pure function that every process of a run calls."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from safestage_eval._process.within import within_limits
from safestage_eval.episode.contradiction import ContradictionError
from safestage_eval.errors import InputError, shortened, visible
from safestage_eval.formats import EpisodeRef
from safestage_eval.verdicts.problem import Problem

if TYPE_CHECKING:
    from safestage_eval.episode import Episode
    from safestage_eval.evidence.cache_folder import CacheFolder
    from safestage_eval.evidence.store import Store
    from safestage_eval.rules import BindFile, RuleSet
    from safestage_eval.verdicts import EpisodeResult


Look = Callable[["Episode", "RuleSet", "BindFile | None", "EpisodeResult"], dict[str, Any]]
"""Finds more in an episode that was judged, as JSON values: ``EpisodeResult.audit``."""


def score_episode(
    ref: EpisodeRef,
    rules: RuleSet,
    overrides: Mapping[str, str] | None = None,
    bind: BindFile | None = None,
    backend: str = "gjk",
    *,
    assigned_only: bool = False,
    cache: str | Path | CacheFolder | None = None,
    look: Look | None = None,
) -> EpisodeResult | Problem:
    """Open and judge one episode; whatever is wrong with it becomes a problem, not an exception."""
    try:
        with within_limits(ref.shown):
            return _scored(
                ref, rules, overrides, bind, backend, assigned_only=assigned_only, cache=cache,
                look=look,
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
    backend: str,
    *,
    assigned_only: bool,
    cache: str | Path | CacheFolder | None,
    look: Look | None,
) -> EpisodeResult:
    """The result. Raises InputError."""
    from safestage_eval.verdicts import judge

    if ref.problem is not None:
        raise ref.problem

    def judged(episode: Episode, store: Store | None = None) -> EpisodeResult:
        result = judge(
            episode, rules, overrides=overrides, bind=bind, backend=backend,
            assigned_only=assigned_only, store=store,
        )  # fmt: skip
        if look is None:
            return result
        return replace(result, audit=look(episode, rules, bind, result))

    if cache is None:
        return judged(ref.open())
    from safestage_eval.evidence.cache_folder import CacheFolder
    from safestage_eval.evidence.disk_store import DiskStore
    from safestage_eval.verdicts.verdict_json import result_from_json, to_json

    from .result_question import result_question

    folder = cache if isinstance(cache, CacheFolder) else CacheFolder(cache)
    asked = result_question(ref, rules, overrides, bind, backend, assigned_only=assigned_only)
    asked += " looked at" * (look is not None)
    store = DiskStore(folder, ref)
    stored = store.answer(asked, lambda: to_json(judged(store.episode, store)))
    store.save()
    return result_from_json(stored, ref.shown)


def _told(error: Exception) -> str:
    """An unforeseen error in one line, with the place in the code where it came up."""
    place, trace = "", error.__traceback__
    while trace is not None:
        code = trace.tb_frame.f_code
        place, trace = f"{Path(code.co_filename).name}:{trace.tb_lineno}", trace.tb_next
    return f"{type(error).__name__}: {visible(shortened(str(error)))} ({place})"
