"""Checks of motion: poses and velocities are of the same body and unit, and nothing jumps or sinks."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Body
from safestage_eval.episode.contradiction import POSES, Column, ContradictionError, doubt
from safestage_eval.episode.rounding import most_off

from .check_registry import check
from .column_comparisons import compare_motion, lengths
from .columns import Columns

F32 = NDArray[np.float32]

PAIRS = (("position", "linear_velocity"), ("orientation", "angular_velocity"))
"""Poses, and velocities that say how they change."""

WINDOW = 0.25
"""s over which motion is added up before it is compared: a body that chatters at rest has fast
velocities that come to nothing."""

LONGEST = {"position": 0.1, "orientation": 0.009}
"""s; from velocities further apart nobody can tell how a body moved in between. A mechanism vibrates
at the rate of its controller (60 Hz in recorded episodes): sampled at 60 Hz or slower, its angular
velocity says nothing of its turns. A thing in a gripper may shake with the period of two or four
physics steps: sampled at 100 Hz its angular velocity is always that of one side of the shake."""

SHAKE = {"position": 0.1, "orientation": 0.4}
"""m/s and rad/s by which velocities may say more than poses. A hand that presses a thing onto something
shakes with the period of four physics steps: recorded at 120 Hz, its angular velocity is for seconds that
of one side of the shake, 0.3 rad/s, while it hardly turns. A mug that rattles between two fingers (Meta-World,
100 Hz) is up to 0.1 m/s faster than its way."""

LEAST = {"position": 0.05, "orientation": 0.2}
"""m and rad (root of the sum of squares over windows): less motion is not compared."""

DIFFERS = {"position": 0.45, "orientation": 0.6}
"""Share of the motion by which poses and velocities may differ. In recorded episodes it is .09 and
.31 at the most, thinned to 10 Hz .31 of positions. Velocities mirrored differ by 2, ten times too
large by .9, twice by .5; those of another body, or of quaternions in another order, by about 1."""

JUMP = {"position": (0.05, 5.0), "orientation": (1.0, 50.0)}
"""m and m/s, rad and rad/s: how far a step may lead from where velocities do. No collision changes
a speed by more than 10 m/s, and half of that acts over the step; recorded episodes stay below 1 cm
and 0.13 rad."""

FASTEST = 20.0
"""m/s; of a body without velocities, a step beyond (and 5 cm) is no motion. It has fallen from 20 m."""

NOISY = (0.8, 1.25)
"""Share of the poses' motion that the velocities hold where they are that motion with noise (PhysX): poses
are believed then. Other units, axes, signs and bodies give other shares."""

MOTION: tuple[Column, ...] = (*POSES, "linear_velocity", "angular_velocity")
RATES: dict[str, tuple[Column, ...]] = {
    "position": ("linear_velocity",),
    "orientation": ("angular_velocity",),
}

WORDS = {
    "position": ("position", "linear velocity", "m"),
    "orientation": ("orientation", "angular velocity", "rad"),
}


class _Compared(NamedTuple):
    """How the poses of a body and its velocities differ.

    Attributes:
        kind: ``position`` or ``orientation``.
        over, frame: m or rad by which a step differs by more than it may, and the frame behind it; -1
            where none does.
        by_pose, by_velocity, apart: m or rad, as ``Motions.sizes``.
    """

    kind: str
    over: float
    frame: int
    by_pose: float
    by_velocity: float
    apart: float

    @property
    def differ(self) -> bool:
        """Poses and velocities are not of the same motion."""
        most = max(self.by_pose, self.by_velocity)
        return most > LEAST[self.kind] and self.apart > DIFFERS[self.kind] * most


@check(
    "AUD114",
    "error",
    title="a body jumps",
    why="A reset or a swapped row looks like a throw: drops, displacements and clearances around it "
    "are not what happened.",
    example="an environment that was reset in the middle of the recording",
    unless=("AUD101", "AUD102", "AUD111", "AUD113", "AUD115", "AUD118"),
    over="columns",
)
def jumps(columns: Columns) -> Iterator[ContradictionError]:
    """Looks for steps that the velocities do not explain, or that no body makes."""
    t = columns.t
    for body, compared in _compared(columns):
        for one in compared:
            if one.frame >= 0:
                what, rate, unit = WORDS[one.kind]
                yield doubt(
                    f"{body.name!r} jumps at {t[one.frame]:.3f} s: its {what} changes otherwise than its "
                    f"{rate} can explain, by more than {one.over + JUMP[one.kind][0]:.3g} {unit} in "
                    "one step.",
                    "motion without jumps",
                    "record resets as episodes of their own; look for exchanged rows or quaternions",
                    bodies=(body.name,),
                    time=t[one.frame],
                    hides=MOTION,
                )
        place = columns.track(body, "position")
        if place is None or columns.track(body, "linear_velocity") is not None:
            continue
        if len(place) < 2 or len(place) != len(t):
            continue
        step, unseen = np.diff(t), columns.episode.unseen
        went = lengths(np.diff(place, axis=0))
        over = np.where(step > LONGEST["position"], np.nan, went - FASTEST * step)
        if unseen is not None:
            over[unseen[1:] | unseen[:-1]] = np.nan
        far, least = over > JUMP["position"][0], JUMP["position"][0]
        if far.any() and np.nanmax(over) > least + 2 * most_off(place):
            i = int(np.nanargmax(over)) + 1
            yield doubt(
                f"{body.name!r} jumps by {went[i - 1]:.3g} m at {t[i]:.3f} s, within {step[i - 1]:.3g} s.",
                "motion without jumps",
                "record resets as episodes of their own; look for exchanged rows",
                bodies=(body.name,),
                time=t[i],
                hides=MOTION,
            )


@check(
    "AUD115",
    "error",
    title="velocities are not those of the poses",
    why="Rest, impact, falls and moving are judged by velocities, places by poses; they must be of the "
    "same body, in m/s and rad/s, in the world's axes, of the body frame's origin.",
    example="angular velocities in the body's own axes, as MuJoCo's free joints give them",
    issue="iit-DLSLab/gym-quadruped#31",
    unless=("AUD101", "AUD102", "AUD111", "AUD113", "AUD118"),
    over="columns",
)
def velocities(columns: Columns) -> Iterator[ContradictionError]:
    """Adds up velocities over quarter seconds and compares them with the change of the poses."""
    for body, compared in _compared(columns):
        for one in compared:
            if one.frame >= 0 or not one.differ:
                continue
            what, rate, unit = WORDS[one.kind]
            kind, by_pose, by_velocity, apart = one.kind, one.by_pose, one.by_velocity, one.apart
            ratio = by_velocity / by_pose if by_pose > 0 else np.inf
            # velocities = k · motion of the poses + noise across it
            k = 0.0
            if by_pose > LEAST[kind]:
                k = (by_pose**2 + by_velocity**2 - apart**2) / (2 * by_pose**2)
            yield doubt(
                f"the {rate} of {body.name!r} is not that of its {what}: the one says "
                f"{by_velocity:.3g}, the other {by_pose:.3g} {unit} (ratio {ratio:.3g}), and they "
                f"differ by {apart:.3g}.",
                "velocities of the body frame's origin in the world, m/s and rad/s; quaternions wxyz",
                "look for other units, axes, a body-fixed frame, another body's column, or xyzw; "
                "or leave velocities out (NaN): they are then derived from the poses",
                bodies=(body.name,),
                hides=RATES[kind] if NOISY[0] <= k <= NOISY[1] else MOTION,
            )


def _compared(columns: Columns) -> list[tuple[Body, list[_Compared]]]:
    """Each body that moves, with what poses and velocities of it are at hand."""
    known: list[tuple[Body, list[_Compared]]] | None = columns.found.get("motion")
    if known is None:
        known = columns.found["motion"] = [
            (body, [*_compare(columns, body)]) for body in columns.some if body.movable
        ]
    return known


def _compare(columns: Columns, body: Body) -> Iterator[_Compared]:
    """Both pairs of columns of a body; a velocity that is zero throughout was not recorded."""
    t = columns.t
    for kind, speed in PAIRS:
        pose, rate = columns.track(body, kind), columns.track(body, speed)
        if pose is None or rate is None or len(pose) < 2:
            continue
        if len(pose) != len(t) or len(rate) != len(t) or not _some(rate):
            continue
        motion = compare_motion(t, pose, rate, columns.episode.unseen, LONGEST[kind], WINDOW)
        one = _Compared(kind, *motion.beyond(*JUMP[kind]), *motion.sizes(SHAKE[kind]))
        if one.frame >= 0 or one.differ:
            off = 2 * most_off(pose) * (1 if kind == "position" else 2)
            step = motion.beyond(JUMP[kind][0] + off, JUMP[kind][1])
            off += WINDOW * most_off(rate)
            one = _Compared(kind, *step, *motion.sizes(SHAKE[kind], off))
        yield one


@check(
    "AUD116",
    "error",
    title="a body is below the floor",
    why="A body that fell through the floor was disturbed by the simulator, not by the robot.",
    example="an object at z = -37 m at the end of the rollout",
    unless=("AUD101", "AUD113"),
    over="columns",
)
def below_floor(columns: Columns) -> Iterator[ContradictionError]:
    """Compares places with infinite horizontal planes."""
    t, floors = columns.t, []
    for body in columns.some:
        if not body.movable and any(geom.kind == "plane" for geom in body.geoms):
            turn, place = columns.track(body, "orientation"), columns.track(body, "position")
            if place is not None and turn is not None and abs(turn[0, 0]) > 0.999:
                floors.append((body.name, float(place[0, 2])))
    for body in columns.some if floors else ():
        place = columns.track(body, "position") if body.movable else None
        shapes = None if place is None else columns.shapes(body)
        if place is None or shapes is None or not len(place):
            continue
        for name, floor in floors:
            low = floor - shapes.radius - 0.05
            if not place[:, 2].min() < low or not place[:, 2].min() < low - most_off(place):
                continue
            i = int(place[:, 2].argmin())
            when = t[min(i, len(t) - 1)]
            yield doubt(
                f"{body.name!r} is {floor - place[i, 2]:.3g} m below the floor {name!r} at {when:.3f} s.",
                "nothing below a plane, which is a half-space",
                "look for another unit or axis of the poses; or it fell through in the simulation",
                bodies=(body.name,),
                time=when,
                hides=MOTION,
            )


def _some(column: F32) -> bool:
    """Not zero throughout."""
    if column[len(column) // 2].any():  # mostly; then the rest need not be looked at
        return True
    with np.errstate(all="ignore"):
        return bool(column.max() != 0 or column.min() != 0)
