"""Summaries of episodes for the checks of an evaluation."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from safestage_eval.errors import InputError, readable

from .subject import Subject

MOVED = 0.005
"""m: a body that is so far from where it began has moved."""

TURNED = 0.05
"""rad: a body, or a joint, that turned further has moved."""

LEFT, FALLEN = 0.02, 0.26
"""m, rad: what has gone so far since success does not only settle."""

WAYPOINTS = 16
"""Moments, evenly spread over the recording, at which all bodies' positions are kept."""

Commands = Literal["not recorded", "missing", "constant", "varied"]
"""Commands of a rollout: no column; NaN throughout; the same in every frame; different ones."""


class Goal(NamedTuple):
    """Recorded state of the goal that header, bind file or rule file name.

    Attributes:
        first: s when it was first confirmed; None if it certainly never was.
        unsure: the recording does not tell whether it ever was.
        at_start: it was confirmed as soon as a goal can be.
        undone: it does not hold in the last frame, and what it is about has moved since.
    """

    first: float | None
    unsure: bool
    at_start: bool
    undone: bool


@dataclass(frozen=True)
class Summary:
    """Summary of one episode for the checks of an evaluation; small, can be pickled.

    Attributes:
        episode_id, task, policy, prompt, seed, rollout: of the header.
        path: of its file, as printed.
        success, success_time, termination, horizon: of the header.
        content_hash: as the file states it; None if it states none.
        duration: s, from the first sample to the last.
        start: movable body outside the robot → position (m) and orientation (wxyz) in the first
            frame, rounded to float32.
        waypoints: (``WAYPOINTS``, B, 3) float32, m: where all movable bodies were; as bytes.
        stirred: s when a movable body outside the robot was first away from where it began; None:
            never.
        targets: bodies that play the role ``target``.
        target_moved: as ``stirred``, of a target.
        touched: s when the robot, or what it had touched, first touched a target; None: never.
        contacts: contacts are recorded, so that ``touched`` says something.
        robot_travel: m that the robot got away from where it began, by its last body, or by the one
            that went furthest if that one stood still; None without a robot, or where only joints move.
        commands: that the policy gave.
        goal: None without a goal, or where it was not looked at.
        names_goal: header, bind file or rule file name a goal that is loaded.
    """

    episode_id: str
    path: str
    task: str | None
    policy: str | None
    prompt: str | None
    seed: int | None
    rollout: int | None
    success: bool | None
    success_time: float | None
    termination: str | None
    horizon: float | None
    content_hash: str | None
    duration: float
    start: tuple[tuple[str, tuple[float, ...]], ...] = ()
    waypoints: bytes = b""
    stirred: float | None = None
    targets: tuple[str, ...] = ()
    target_moved: float | None = None
    touched: float | None = None
    contacts: bool = False
    robot_travel: float | None = None
    commands: Commands = "not recorded"
    goal: Goal | None = None
    names_goal: bool = False

    @property
    def engaged(self) -> bool | None:
        """Whether the robot did anything to a target; None if the recording does not tell."""
        if self.touched is not None or self.target_moved is not None:
            return True
        known = bool(self.targets) and (self.contacts or (self.robot_travel or 1.0) < MOVED)
        return False if known else None

    @cached_property
    def places(self) -> NDArray[np.float32]:
        """The waypoints as an array (``WAYPOINTS``, B, 3)."""
        return np.frombuffer(self.waypoints, np.float32).reshape(WAYPOINTS, -1, 3)


def summarize(subject: Subject, content_hash: str | None = None, *, goal: bool = True) -> Summary:
    """The summary of an episode.

    Args:
        subject: the episode.
        content_hash: as its file states it.
        goal: look for the goal in every frame, and keep waypoints, which takes longer than all the
            rest.
    """
    header, t = subject.header, subject.episode.t
    robot = {body.name for body in header.bodies if body.kind in ("robot", "gripper")}
    moving = [body.name for body in header.bodies if body.movable]
    things = [name for name in moving if name not in robot]
    targets = _targets(subject)
    away = {name: _away(subject, name) for name in things}
    start = [
        (name, (*map(float, track.position[0]), *map(float, track.orientation[0])))
        for name in things
        if len((track := subject.track(name)).position)
    ]
    return Summary(
        episode_id=header.episode_id,
        path=readable(subject.episode.path or ""),
        task=header.task,
        policy=header.policy,
        prompt=header.prompt,
        seed=header.seed,
        rollout=header.rollout,
        success=header.success,
        success_time=header.success_time,
        termination=header.termination,
        horizon=header.horizon,
        content_hash=content_hash,
        duration=float(t[-1] - t[0]) if len(t) else 0.0,
        start=tuple(start),
        waypoints=_waypoints(subject, moving) if goal else b"",
        stirred=_first(t, away.values()),
        targets=targets,
        target_moved=_first(t, (away[name] for name in targets if name in away)),
        touched=_touched(subject, robot, targets),
        contacts=bool(subject.episode.contacts.pairs),
        robot_travel=_robot_travel(subject, [name for name in moving if name in robot]),
        commands=_commands(subject.episode.frames.action),
        goal=_goal(subject) if goal else None,
        names_goal=subject.binding is not None and subject.binding.goal is not None,
    )


def _targets(subject: Subject) -> tuple[str, ...]:
    """Those of all sources; of a joint, the body that it moves."""
    roles = subject.header.roles if subject.binding is None else subject.binding.roles
    moved_by = {joint.name: joint.body for joint in subject.header.joints}
    named = [moved_by.get(name) or name for name in roles.get("target", ())]
    return tuple(name for name in named if name in subject.episode.tracks)


def _away(subject: Subject, name: str) -> NDArray[np.bool_]:
    """(T,) where a body is not where it began."""
    track = subject.track(name)
    gap = np.linalg.norm(track.position - track.position[:1], axis=1)
    same = np.abs((track.orientation * track.orientation[:1]).sum(1))
    moved: NDArray[np.bool_] = (gap > MOVED) | (same < np.cos(TURNED / 2))
    return moved


def _robot_travel(subject: Subject, links: Sequence[str]) -> float | None:
    """Travel of the robot's last body, or of the furthest one if that stood still.

    None where no body moves and joints do: what they move has no poses.
    """
    if not links:
        return None
    last = _travel(subject, links[-1])
    furthest = last if last >= MOVED else max(_travel(subject, name) for name in links)
    joints = subject.episode.frames.joint_position
    turned = float(np.nanmax(np.abs(joints - joints[:1]), initial=0.0))
    return None if furthest < MOVED and turned > TURNED else furthest


def _travel(subject: Subject, name: str) -> float:
    position = subject.track(name).position
    return float(np.nanmax(np.linalg.norm(position - position[:1], axis=1), initial=0.0))


def _first(t: NDArray[np.float64], when: Iterable[NDArray[np.bool_]]) -> float | None:
    """Moment (s) of the first frame in which any of them holds."""
    frames = [int(held.argmax()) for held in when if held.any()]
    return float(t[min(frames)]) if frames else None


def _touched(subject: Subject, robot: set[str], targets: Sequence[str]) -> float | None:
    """When the robot, or what it had touched before and can move, first touched a target."""
    contacts, bodies = subject.episode.contacts, subject.header.bodies
    still = {i for i, body in enumerate(bodies) if not body.movable and body.name not in robot}
    begun = {i: 0 for i, body in enumerate(bodies) if body.name in robot}
    pairs = [pair for pair in contacts.pairs if not {*pair} & still]
    changed = True
    while changed:
        changed = False
        for one, other in [*pairs, *((b, a) for a, b in pairs)]:
            if one in begun and begun.get(other, len(subject.episode)) > begun[one]:
                frames = contacts.of_pair((min(one, other), max(one, other)), "frame")[0]
                later = frames[frames >= begun[one]]  # they may be in any order
                if len(later) and later.min() < begun.get(other, len(subject.episode)):
                    begun[other], changed = int(later.min()), True
    first = [begun[i] for i, body in enumerate(bodies) if body.name in targets and i in begun]
    return float(subject.episode.t[min(first)]) if first else None


def _waypoints(subject: Subject, moving: Sequence[str]) -> bytes:
    count = len(subject.episode)
    frames = np.linspace(0, max(count - 1, 0), WAYPOINTS).round().astype(np.int64)
    some = [name for name in moving if len(subject.track(name).position) == count]
    places = [subject.track(name).position[frames] for name in some] if count else []
    return np.stack(places, 1).astype(np.float32).tobytes() if places else b""


def _commands(action: NDArray[np.float32]) -> Commands:
    if not action.shape[1] or not len(action):
        return "not recorded"
    if np.isnan(action).all():
        return "missing"
    return "constant" if len(action) > 1 and (action == action[:1]).all() else "varied"


def _goal(subject: Subject) -> Goal | None:
    """State of the goal in a sound recording."""
    binding = subject.binding
    if binding is None or binding.goal is None or not subject.sound:
        return None
    from safestage_eval.verdicts.evaluate import Evaluator
    from safestage_eval.verdicts.goal import CONFIRM, goal_over_time

    episode = subject.relations.episode
    causal = Evaluator(subject.relations, subject.rules, binding.params(None), None, causal=True)
    lasts = [CONFIRM, *([binding.goal.for_] if binding.goal.for_ is not None else [])]
    windows, count = [causal.window(duration) for duration in lasts], len(episode)
    soonest = max(window.stop(0) for window in windows)
    goal_of = causal, binding.goal, binding.goal_players()
    frames = np.arange(count)
    expected = np.searchsorted(episode.t, subject.header.success_time or np.inf)
    early = frames < min(window.stop(min(int(expected) + 1, count)) for window in windows)
    late = frames >= min(window.first(count) for window in windows)
    try:  # most often it is confirmed where the header says; then only the end is of interest
        sure, perhaps = goal_over_time(*goal_of, early | late)
        if not (sure & early).any():
            sure, perhaps = goal_over_time(*goal_of)
    except InputError:  # a name in the goal that the trace does not bear
        return None
    first = int(sure.argmax()) if sure.any() else None
    lost = first is not None and not perhaps[-1]
    players = {body for bodies in binding.goal_players().values() for body in bodies}
    return Goal(
        None if first is None else float(episode.t[first]),
        first is None and bool(perhaps.any()),
        first is not None and first <= soonest,
        lost and any(_left(subject, body, float(episode.t[first or 0])) for body in players),
    )


def _left(subject: Subject, name: str, since: float) -> bool:
    """Whether a body is not where it was at a moment (s)."""
    if name not in subject.episode.tracks:
        return False
    track = subject.track(name)
    if len(track.position) < 2:
        return False
    then = min(int(np.searchsorted(subject.episode.t, since)), len(track.position) - 1)
    same = abs(float(track.orientation[then] @ track.orientation[-1]))
    gap = float(np.linalg.norm(track.position[-1] - track.position[then]))
    return gap > LEFT or same < np.cos(FALLEN / 2)


@dataclass(frozen=True)
class Campaign:
    """Everything that was audited, as the checks of an evaluation see it.

    Attributes:
        episodes: summaries of all that could be read, in the order in which they were found.
        unreadable: how many could not be read.
        aborted: ids of rollouts that ended in an error; they are in no other number.
    """

    episodes: Sequence[Summary]
    unreadable: int = 0
    aborted: Sequence[str] = ()
