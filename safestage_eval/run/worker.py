"""What a worker process does: it judges the episodes that it is sent, one after the other."""

from __future__ import annotations

import gc
import json
from collections.abc import Callable
from typing import Any, NamedTuple

from safestage_eval._process import heap
from safestage_eval.formats import EpisodeRef
from safestage_eval.verdicts import EpisodeResult
from safestage_eval.verdicts.problem import Problem

from .score_episode import score_episode
from .settings import Settings

GARBAGE = 20_000
"""Objects between two looks for garbage. At Python's 700, looking took a twentieth of an audit."""


class Line(NamedTuple):
    """A result as it is stored, and by what it is known again."""

    text: bytes
    episode_id: str
    trace_hash: str


def opened(
    settings: Settings, lines: bool
) -> Callable[[EpisodeRef], EpisodeResult | Line | Problem]:
    """What scores an episode; ``lines``: and gives its result as it is stored."""
    rules, arguments = settings.rule_set, settings.arguments()

    def judge(ref: EpisodeRef) -> EpisodeResult | Line | Problem:
        result = score_episode(ref, rules, **arguments)
        return line_of(result) if lines else result

    return lasting(judge)


def lasting(answer: Callable[[EpisodeRef], Any]) -> Callable[[EpisodeRef], Any]:
    """The same, for a process that answers for many episodes: free memory neither grows nor is handed back each time."""
    heap.keep()
    bound = heap.Bound()
    gc.set_threshold(GARBAGE)
    gc.freeze()  # what is there by now stays: collections after an episode need not look at it

    def answers(ref: EpisodeRef) -> Any:
        bound.hold()
        return answer(ref)

    return answers


def line_of(result: EpisodeResult | Problem) -> Line | Problem:
    """A result as it is stored; a problem as it is."""
    if isinstance(result, Problem):
        return result
    from safestage_eval.verdicts.verdict import to_json

    text = json.dumps(to_json(result), separators=(",", ":"), ensure_ascii=False).encode()
    return Line(text, result.episode_id, result.trace_hash)
