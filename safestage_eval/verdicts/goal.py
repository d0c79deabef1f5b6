"""Native success: as the trace records it, recomputed from the goal, or watched for while recording."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from safestage_eval.episode import Episode, Header, with_holes
from safestage_eval.errors import RuleError
from safestage_eval.evidence import intervals
from safestage_eval.evidence.intervals import F64, Bool
from safestage_eval.evidence.measure import Signals
from safestage_eval.relations.relations import Relations
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.episode_binding import bind_episode
from safestage_eval.rules.load import load_rules
from safestage_eval.signals import SIGNALS

from .evaluate import Evaluator
from .language import ends_early, lacks_its_success
from .players import nodes, taken_one_by_one
from .windows import held_until

CONFIRM = ast.Duration(3, frames=True)
"""The goal must be true for so many frames; success is the frame that confirms it."""


class Reached(NamedTuple):
    """Whether a goal was reached.

    Attributes:
        frame: the first one that confirms it; None if none certainly does.
        unsure: no frame certainly confirms it, but the trace lacks what would rule it out.
    """

    frame: int | None
    unsure: bool = False


def first_success(
    evaluator: Evaluator,
    goal: ast.GoalDef,
    players: Mapping[str, Sequence[str]],
    hint: int | None = None,
    start: int = 0,
) -> Reached:
    """The first frame that confirms the goal.

    Causal: whether a frame confirms depends on no later frame. ``evaluator`` must be causal.
    ``hint``: a frame by which the goal is probably confirmed; saves looking further if it is.
    ``start``: the first frame that may confirm it; those before are only looked back to.
    """
    if hint is not None and hint + 1 < evaluator.frames:
        reached = _first_success(evaluator, goal, players, start, hint + 1)
        if reached.frame is not None:
            return reached
    return _first_success(evaluator, goal, players, start, evaluator.frames)


def _first_success(
    evaluator: Evaluator,
    goal: ast.GoalDef,
    players: Mapping[str, Sequence[str]],
    start: int,
    stop: int,
) -> Reached:
    margins = _margins(evaluator, goal, players, np.arange(evaluator.frames) < stop)
    if margins is None:
        return Reached(None, unsure=True)
    looked_at = slice(start, stop)
    confirmed = np.flatnonzero(_confirmed(evaluator, goal, margins.lower)[looked_at])
    unseen = evaluator.clock.unseen
    if len(confirmed) and unseen is None:
        return Reached(start + int(confirmed[0]))
    perhaps = _confirmed(evaluator, goal, margins.upper)[looked_at]
    if len(confirmed):
        first = start + int(confirmed[0])
        hidden = unseen is not None and bool((perhaps & unseen[looked_at])[: first - start].any())
        return Reached(None if hidden else first, unsure=hidden)
    return Reached(None, bool(perhaps.any()))


def goal_over_time(
    evaluator: Evaluator,
    goal: ast.GoalDef,
    players: Mapping[str, Sequence[str]],
    wanted: Bool | None = None,
) -> tuple[Bool, Bool]:
    """(T,) where the goal is certainly confirmed, and where it may be; arguments as ``first_success``.

    ``wanted``: (T,) frames to be looked at, None: all. What comes back means nothing in the others,
    nor where a confirmation would begin in one of them.
    """
    every = np.ones(evaluator.frames, np.bool_)
    margins = _margins(evaluator, goal, players, every if wanted is None else wanted)
    if margins is None:
        return np.zeros(evaluator.frames, np.bool_), np.ones(evaluator.frames, np.bool_)
    return _confirmed(evaluator, goal, margins.lower), _confirmed(evaluator, goal, margins.upper)


def goal_margin(episode: Episode, rules: Sequence[str] = ("goals",)) -> float | None:
    """Least margin of its goal that an episode ends with, in shares of the limit; negative if unmet.

    Infinite where only yes or no counts; None without a goal, or with a role that has no body.
    """
    loaded = load_rules(rules)
    binding = bind_episode(loaded, episode.header)
    if binding.goal is None:
        return None
    evaluator = Evaluator(Relations(Signals(episode)), loaded, binding.params(None), None)
    last = np.arange(len(episode)) == len(episode) - 1
    margins = _margins(evaluator, binding.goal, binding.goal_players(), last)
    return None if margins is None else float(margins.lower[-1])


def _margins(
    evaluator: Evaluator, goal: ast.GoalDef, players: Mapping[str, Sequence[str]], wanted: Bool
) -> intervals.Interval | None:
    """The goal's margin at the wanted frames; None where a role has no body."""
    evaluator.players = players
    names = [name for name, _ in goal.roles]
    free = taken_one_by_one(goal, goal.require)
    if any(not players.get(name) for name in names):
        return None
    return intervals.both(
        [
            evaluator.evaluate(
                goal.require, dict(zip(free, bodies, strict=True)), None, wanted
            ).margin
            for bodies in itertools.product(*(players.get(name, ()) for name in free))
        ]
        or [intervals.crisp(np.zeros(evaluator.frames, np.bool_))],
        evaluator.frames,
    )


def _confirmed(evaluator: Evaluator, goal: ast.GoalDef, margin: F64) -> Bool:
    """(T,) where the goal, with the given margin (T,), has been reached for long enough."""
    out: Bool = held_until(margin, evaluator.window(CONFIRM)) >= 0
    if goal.for_ is not None:
        out &= held_until(margin, evaluator.window(goal.for_)) >= 0
    return out


def _needs(
    rules: ast.RuleSet, goal: ast.GoalDef, players: Mapping[str, Sequence[str]]
) -> Iterator[tuple[ast.Atom, dict[str, str]]]:
    """Relations and signals that must all hold for a goal to hold, each with role → body."""
    names = [name for name, _ in goal.roles]
    if any(not players.get(name) for name in names):
        return
    for bodies in itertools.product(*(players[name] for name in names)):
        yield from _parts(rules, goal.require, dict(zip(names, bodies, strict=True)))


def _parts(
    rules: ast.RuleSet, condition: ast.Condition, env: dict[str, str]
) -> Iterator[tuple[ast.Atom, dict[str, str]]]:
    """Parts of a condition: the states in it are taken apart as long as they hold just when their condition does."""
    for atom in condition.atoms:
        if isinstance(atom, ast.SignalAtom):
            yield atom, env
        elif isinstance(atom, ast.StateAtom):
            state = rules.states.get(atom.call.name)
            if state is None:
                yield atom, env
            elif atom.want and not any(
                (state.for_, state.gap, state.also, state.until, state.fallback, state.perhaps)
            ):
                bodies = [env.get(arg, arg) for arg in atom.call.args]
                yield from _parts(rules, state.when, dict(zip(state.of, bodies, strict=True)))


class GoalMonitor:
    """Watches a rollout while it is recorded, and says when the goal was reached."""

    def __init__(
        self,
        rules: ast.RuleSet,
        goal: ast.GoalDef,
        params: ast.Params,
        players: Mapping[str, Sequence[str]],
        frame_dt: float,
    ) -> None:
        """Watch for a goal.

        Args:
            rules: where the states that the goal uses are declared.
            goal: what to watch for.
            params: values of the parameters.
            players: role → bodies.
            frame_dt: s between recorded frames.
        """
        self._rules, self._goal, self._params, self._players = rules, goal, params, players
        self._needs = list(_needs(rules, goal, players))
        self.window_frames = self._lookback(frame_dt)
        """How many past frames ``update`` needs, besides the new ones; None for all of them."""

    @classmethod
    def of(cls, header: Header, rules: Sequence[str] = ("goals",)) -> GoalMonitor:
        """A monitor of the goal that a header names, found in rule files.

        Raises RuleError when the header names no goal, or one that no rule file has.
        """
        loaded = load_rules(rules)
        binding = bind_episode(loaded, header)
        if binding.goal is None:
            raise RuleError(
                f"task {header.task!r}",
                f"no goal to watch for: {header.goal!r}.",
                ", ".join(sorted(loaded.goals)),
            )
        return cls(
            loaded, binding.goal, binding.params(None), binding.goal_players(), header.frame_dt
        )

    def update(self, window: Episode, new: int) -> float | None:
        """Time (s) of the first new frame that confirms the goal, None if none does.

        The window's last ``new`` frames are those that no earlier window held. It must start
        ``window_frames`` before the first of them, or at the start of the episode. Those older
        frames confirm nothing: what had begun before the window is not known at its start.
        """
        signals = Signals(with_holes(window, begins=False))
        signals.gaps.whole = False
        evaluator = Evaluator(Relations(signals), self._rules, self._params, None, causal=True)
        start = max(0, len(window) - new)
        if self._ruled_out(evaluator, start):
            return None
        frame = first_success(evaluator, self._goal, self._players, start=start).frame
        return None if frame is None else float(window.t[frame])

    def _ruled_out(self, evaluator: Evaluator, start: int) -> bool:
        """Whether one thing that the goal needs is lacking in all frames from ``start`` on.

        What ruled it out last time is asked first: it takes a fifth of the time of all of it.
        """
        evaluator.players = self._players
        for place, (atom, env) in enumerate(self._needs):
            if evaluator.is_costly(atom):
                continue
            if (evaluator.evaluate(atom, env).margin.lower[start:] < 0).all():
                self._needs.insert(0, self._needs.pop(place))
                return True
        return False

    def _looks_far_back(self, name: str) -> bool:
        computed = self._rules.derived.get(name)
        if computed is not None:
            return computed.operation in ("integral", "sparc")
        variant = self._rules.signals.get(name)
        return SIGNALS[name if variant is None else variant.base].far_back

    def _lookback(self, frame_dt: float) -> int | None:
        todo: list[ast.Condition | ast.DerivedDef] = [self._goal.require]
        seen, total = set[str](), 0.0
        durations = [self._goal.for_ or CONFIRM]
        while todo:
            for node in nodes(todo.pop()):
                if isinstance(node, ast.SignalAtom) and (
                    node.since is not None or self._looks_far_back(node.call.name)
                ):
                    return None
                if isinstance(node, ast.Call) and node.name in {*self._rules.derived} - seen:
                    seen.add(node.name)
                    todo.append(self._rules.derived[node.name])
                    computed = self._rules.derived[node.name]
                    if computed.operation == "derivative":
                        durations.append(computed.over or ast.Duration(1, frames=True))
                if isinstance(node, ast.Call) and node.name in self._rules.states:
                    state = self._rules.states[node.name]
                    if state.until is not None:
                        return None
                    if node.name not in seen:
                        seen.add(node.name)
                        todo.append(state.when)
                        todo += [c for c in (state.fallback, state.perhaps) if c is not None]
                        durations += [d for d in (state.for_, state.gap) if d is not None]
        for duration in durations:
            value = self._params[duration.name] if isinstance(duration, ast.Parameter) else duration
            if isinstance(value, ast.Duration):
                total += value.amount if value.frames else value.amount / frame_dt + value.least
            else:
                total += value.value / frame_dt
        return int(np.ceil(total)) + len(durations)


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
