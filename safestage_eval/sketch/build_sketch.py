"""Build the episode of a sketch: bodies and motion first, then contacts, gripper and the rest."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import (
    Body,
    Episode,
    Geom,
    Header,
    Joint,
    RobotFrames,
    Source,
    Track,
    still_track,
)
from safestage_eval.episode.header import SKETCH
from safestage_eval.geometry.pose import conjugate, product

from . import hand
from .paths import GRAVITY, Paths
from .sketch_contacts import Forces
from .sketch_model import BodySketch, Channel, Hold, JointSketch, Reach, Sketch, Step, Touch
from .solids import AXES, Solid, ground, solid

F64 = NDArray[np.float64]


class BrokenSceneError(ValueError):
    """Something that a sketch asks for cannot be.

    Attributes:
        keys: the entry that is meant.
    """

    def __init__(self, keys: tuple[str | int, ...], message: str) -> None:
        super().__init__(message)
        self.keys = keys


def build(sketch: Sketch, steps: Sequence[Step], name: str) -> Episode:
    """Build the episode that a sketch draws.

    Args:
        sketch: the tables.
        steps: its story.
        name: becomes the episode's id.

    Raises:
        BrokenSceneError: a name that is no body, a fall with nothing beneath, or the gripper at two places.
    """
    t = np.arange(round(sketch.duration * sketch.rate) + 1) / sketch.rate
    solids = _solids(sketch)
    paths = Paths(t, solids, _start(sketch, solids))
    for role, names in sketch.roles.items():
        for body in names:
            if body not in solids:
                raise BrokenSceneError(("roles", role), f"{body!r} is no body of this scene")
    for index, step in sorted(enumerate(steps), key=lambda item: _begins(item[1])):
        try:
            _check_names(step, solids, gripper=sketch.gripper)
            paths.carry_out(step)
        except ValueError as error:
            raise BrokenSceneError(("story", index), str(error)) from None
    forces = Forces(paths, [s for s in steps if isinstance(s, Hold | Touch | Reach)])
    if clash := forces.clash:
        raise BrokenSceneError(
            ("story", steps.index(clash)), "the gripper is at another place then"
        )
    return _episode(sketch, steps, name, paths, forces)


def _episode(
    sketch: Sketch, steps: Sequence[Step], name: str, paths: Paths, forces: Forces
) -> Episode:
    t, bodies = paths.t, [solid.body for solid in paths.solids.values()]
    tracks = {
        b.name: _track(b, t, paths.position[b.name], paths.orientation[b.name]) for b in bodies
    }
    opening = np.zeros((len(t), 0))
    if sketch.gripper:
        poses, share = hand.follow(t, forces.visits)
        opening = share[:, None]
        for body in hand.bodies():
            bodies.append(body)
            tracks[body.name] = _track(body, t, *poses[body.name])
    reached = sketch.success if isinstance(sketch.success, float) else None
    header = Header(
        episode_id=name,
        instruction=sketch.says,
        physics_dt=1 / sketch.rate,
        frame_dt=1 / sketch.rate,
        gravity=(0.0, 0.0, -GRAVITY),
        success=None if sketch.success == "unknown" else reached is not None,
        success_time=reached,
        termination=sketch.termination or ("horizon" if reached is None else "success"),
        post_success_hold=None if reached is None else sketch.duration - reached,
        roles=dict(sketch.roles),
        goal=sketch.goal,
        parameters=sketch.parameters,
        force_source="recorded" if sketch.forces else "none",
        source=Source(recorder=SKETCH),
        bodies=tuple(bodies),
        joints=tuple(
            Joint(name=n, kind=j.kind, body=j.body, limits=j.limits)
            for n, j in sketch.joints.items()
        ),
    )
    return Episode(
        header,
        t,
        tracks,
        forces.table(bodies) if sketch.forces else None,
        _robot(t, list(sketch.joints.values()), opening),
        channels={
            (step.of, step.channel): _along(t, step.values).astype(np.float32)
            for step in steps
            if isinstance(step, Channel)
        },
    )


def _track(body: Body, t: F64, position: F64, orientation: F64) -> Track:
    """Make a track of poses, with the twists that follow from them by differences."""
    if not body.movable:
        return still_track(tuple(position[0]), tuple(orientation[0]))
    if len(t) < 2:
        return Track(*(x.astype(np.float32) for x in (position, orientation)),
                     *np.zeros((2, len(t), 3), np.float32))  # fmt: skip
    step = product(orientation[1:], conjugate(orientation[:-1]))
    step = step * np.where(step[:, :1] < 0, -1, 1)
    size = np.sqrt((step[:, 1:] ** 2).sum(1, keepdims=True))
    angle = 2 * np.arctan2(size, step[:, :1])
    rate = step[:, 1:] / np.maximum(size, 1e-300) * angle / np.diff(t)[:, None]
    turning = np.concatenate([rate[:1], (rate[1:] + rate[:-1]) / 2, rate[-1:]])
    going = np.gradient(position, t, axis=0)
    columns = (position, orientation, going, turning)
    return Track(*(column.astype(np.float32) for column in columns))


def _robot(t: F64, joints: Sequence[JointSketch], opening: F64) -> RobotFrames:
    none = np.zeros((len(t), 0))
    position = np.stack([_along(t, j.position) for j in joints], 1) if joints else none
    torque = np.stack([_along(t, j.torque) for j in joints], 1) if joints else none
    speed = np.gradient(position, t, axis=0) if joints and len(t) > 1 else 0 * position
    columns = (position, speed, torque, none, opening)
    return RobotFrames(*(column.astype(np.float32) for column in columns))


def _along(t: F64, curve: Sequence[tuple[float, float]]) -> F64:
    times, values = zip(*curve, strict=True)
    return np.asarray(np.interp(t, times, values))


def _solids(sketch: Sketch) -> dict[str, Solid]:
    out = {}
    if sketch.table:
        x, y, _ = sketch.table
        top = Geom(kind="box", size=(x / 2, y / 2, 0.02), position=(0.0, 0.0, -0.02))
        out["table"] = Solid(Body(name="table", kind="fixture", movable=False, geoms=(top,)))
    for name, body in sketch.bodies.items():
        if name in out or (sketch.gripper and name in hand.NAMES):
            raise BrokenSceneError(("bodies", name), f"{name} is there already: another name")
        out[name] = solid(name, body)
    return out


def _start(sketch: Sketch, solids: dict[str, Solid]) -> dict[str, tuple[F64, F64]]:
    origin = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
    start: dict[str, tuple[F64, F64]] = {"table": origin} if sketch.table else {}
    waiting = dict(sketch.bodies)
    while waiting:
        ready = [n for n, b in waiting.items() if b.on is None or b.on in start]
        if not ready:
            name, body = next(iter(waiting.items()))
            raise BrokenSceneError(
                ("bodies", name, "on"), f"{body.on!r} is no body that stands itself"
            )
        for name in ready:
            start[name] = _placed(name, waiting.pop(name), solids, start)
    return start


def _placed(
    name: str, body: BodySketch, solids: dict[str, Solid], start: dict[str, tuple[F64, F64]]
) -> tuple[F64, F64]:
    angle, axis = body.turned or (0.0, "z")
    turned = np.array([np.cos(angle / 2), *(np.sin(angle / 2) * AXES[f"+{axis}"])])
    at = np.array(body.at)
    if body.on is None:
        return at, turned
    at[:2] += start[body.on][0][:2]
    level = ground(solids[body.on].faces(start[body.on]), at[:2])
    if level is None:
        raise BrokenSceneError(
            ("bodies", name, "on"), f"{body.on} has no upward face where {name} is"
        )
    at[2] += level - solids[name].bottom((np.zeros(3), turned))[:, 2].min()
    return at, turned


def _begins(step: Step) -> float:
    during = getattr(step, "during", None)
    return float(during[0] if during else getattr(step, "at", 0.0))


def _check_names(step: Step, solids: Mapping[str, Solid], *, gripper: bool) -> None:
    named = getattr(step, step.verb)
    names = (
        [] if isinstance(step, Reach | Channel) else [named] if isinstance(named, str) else named
    )
    names = [*names, *([step.of] if isinstance(step, Channel) else [])]
    if isinstance(step, Touch) and step.by not in ("gripper", *hand.NAMES):
        names.append(step.by)
    for name in names:
        if name not in solids:
            raise ValueError(f"{name!r} is no body of this scene: {', '.join(solids)}")
    by = step.by if isinstance(step, Touch) else ""
    if (isinstance(step, Hold | Reach) or by in ("gripper", *hand.NAMES)) and not gripper:
        raise ValueError("there is no gripper in this scene")
