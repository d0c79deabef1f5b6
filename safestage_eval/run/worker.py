"""A process that judges what it is sent, one episode after the other."""

from __future__ import annotations

import gc
import json
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any

from safestage_eval._process import heap
from safestage_eval._process.spawned import READY, follow
from safestage_eval.formats import EpisodeRef
from safestage_eval.verdicts import EpisodeResult
from safestage_eval.verdicts.problem import Problem

from .engine_interface import Found, Line
from .score_episode import score_episode
from .settings import Settings

GARBAGE = 20_000
"""Objects between two looks for garbage. At Python's 700, looking took a twentieth of an audit."""


def work(pipe: Connection, settings: Settings, *, lines: bool) -> None:
    """Judge lists of episodes until None comes; answers in the order of the questions.

    Args:
        pipe: to the process that started this one. The first answer is ``READY``.
        settings: of the run.
        lines: answer with results as they are stored.
    """
    rules, arguments = settings.rule_set, settings.arguments()

    def judge(ref: EpisodeRef) -> Found:
        result = score_episode(ref, rules, **arguments)
        return line_of(result) if lines else result

    serve(pipe, judge)


def serve(pipe: Connection, answer: Callable[[EpisodeRef], Any]) -> None:
    """Answer for each of the lists of episodes that come, until None does.

    Args:
        pipe: to the process that started this one. The first answer is ``READY``.
        answer: what is sent for an episode; can be pickled.
    """
    follow()
    heap.keep()
    bound = heap.Bound()
    gc.set_threshold(GARBAGE)
    gc.freeze()  # what is there by now stays: collections after an episode need not look at it
    try:
        pipe.send(READY)
        while (refs := pipe.recv()) is not None:
            for ref in refs:
                pipe.send(answer(ref))
                bound.hold()
    except (EOFError, OSError):
        return  # nobody is there any more to answer


def line_of(result: EpisodeResult | Problem) -> Line | Problem:
    """A result as it is stored; a problem as it is."""
    if isinstance(result, Problem):
        return result
    from safestage_eval.verdicts.verdict import to_json

    text = json.dumps(to_json(result), separators=(",", ":"), ensure_ascii=False).encode()
    return Line(text, result.episode_id, result.trace_hash)
