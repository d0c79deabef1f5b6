"""Native success of an episode: as the trace records it, or recomputed from the goal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from safestage_eval.episode import Episode
from safestage_eval.rules import syntax as ast

from .evaluate import Evaluator
from .goal import first_success
from .language import ends_early, lacks_its_success


class Success(NamedTuple):
    """Native success, as far as it is known.

    Attributes:
        frame: that confirmed it; None where there was none, or its moment is not in the trace.
        told: whether there was success; None where that is open.
        ahead: it comes after the trace's last frame.
        notes: where the record and the goal disagree.
    """

    frame: int | None
    told: bool | None
    ahead: bool = False
    notes: tuple[str, ...] = ()

    @property
    def known(self) -> bool:
        """The trace tells when success came, or that none did."""
        return self.told is False or self.frame is not None or self.ahead


def native_success(
    episode: Episode,
    goal: ast.GoalDef | None,
    causal: Evaluator,
    players: Mapping[str, Sequence[str]],
) -> Success:
    """Frame and truth of native success; recorded wins, a disagreement is noted.

    Args:
        episode: what happened.
        goal: its goal in the rule language, if there is one.
        causal: an evaluator that looks only backwards.
        players: role of the goal → bodies.
    """
    header, t = episode.header, episode.t
    recorded = None
    if header.success and header.success_time is not None:
        if header.success_time > t[-1] + 1e-6:
            said = f"the trace ends at {t[-1]:.2f} s, before its success at {header.success_time:.2f} s"
            return Success(None, True, ahead=True, notes=(said,))
        recorded = frame_of(episode, header.success_time)
    if goal is None:
        return Success(recorded, header.success)
    causal.players = players
    reached = first_success(causal, goal, players, hint=recorded)
    if header.success is None:
        cut = ends_early(episode) or lacks_its_success(episode)
        unsure = reached.unsure or (reached.frame is None and cut)
        return Success(reached.frame, None if unsure else reached.frame is not None)
    if header.success and recorded is None:
        return Success(reached.frame, True)
    notes = () if reached.unsure else _disagreement(episode, recorded, reached.frame)
    return Success(recorded, header.success, notes=notes)


def frame_of(episode: Episode, time: float) -> int:
    """The frame at a moment (s) or next after it."""
    return int(np.searchsorted(episode.t, time - 1e-6))


def _disagreement(
    episode: Episode, recorded: int | None, recomputed: int | None
) -> tuple[str, ...]:
    """A note where the recorded success is not that of the goal."""
    t = episode.t
    if recorded is None and recomputed is not None:
        at = f"{t[recomputed]:.2f} s"
        return (f"recorded as no success, but the goal was reached at {at}",)
    if recorded is not None and recomputed is None:
        return ("recorded as success, but the goal is never reached in the trace",)
    if recorded is not None and recomputed is not None and abs(recomputed - recorded) > 1:
        record_time, goal_time = f"{t[recorded]:.3f} s", f"{t[recomputed]:.3f} s"
        return (f"recorded success at {record_time}, goal reached at {goal_time}",)
    return ()
