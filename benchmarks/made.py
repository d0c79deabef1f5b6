"""An episode of the size that the speed targets speak of, made without a simulator.

An arm of convex hulls takes the upper of two stacked boxes, carries it past standing objects, sets
it down on a plate, withdraws, and waits. Everything else rests where it is for the whole episode,
each body on its own contact points, with the noise of a simulator's solver in poses and forces.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import made_motion as motion
import numpy as np
from made_motion import BOX, F64, RATE, SHOULDER
from scipy.spatial.transform import Rotation

from safestage_eval.episode import Body, Geom, Header, Joint, Mesh, Source
from safestage_eval.formats import TraceWriter
from safestage_eval.formats.contact_points import POINT
from safestage_eval.formats.episode_ref import EpisodeRef

G = 9.81


@dataclass(frozen=True)
class Size:
    """How large an episode is made.

    Attributes:
        frames: T.
        objects: movable bodies besides the robot, at least 6.
        protected: how many of them are protected.
        points: contact points under each flat object; 4 is what a box has.
        vertices: of each robot link's hull.
        walls: boxes in the wall of each protected object, which then is a mug; 0: of one shape.
    """

    frames: int = 8000
    objects: int = 20
    protected: int = 3
    points: int = 4
    vertices: int = 96
    walls: int = 0


ROLES: dict[str, dict[str, tuple[str, ...]]] = {
    "ISH": {"target": ("lower",), "dependent": ("upper",)},
    "ETS": {"target": ("upper",)},
    "FSH": {"target": ("upper",)},
}
"""Who is who, by stage; the motion is the same."""

ASSIGNED = {
    "ISH": ("ISH101",),
    "ETS": ("ETS101", "ETS102", "ETS201", "ETS202"),
    "FSH": ("FSH101", "FSH104", "FSH202"),
}
"""The assigned rules, by stage."""


def write(path: Path, stage: str, size: Size = Size(), seed: int = 0) -> EpisodeRef:
    """Make an episode of a stage and store it: an ``.mcap`` name, or a dataset's folder."""
    return make(stage, size, seed).close(path)


def make(stage: str, size: Size = Size(), seed: int = 0) -> TraceWriter:
    """A writer that holds the whole episode."""
    rng = np.random.default_rng(seed)
    t = np.arange(size.frames) / RATE
    hand, opening, held, success = motion.fingertips(t)
    paths = motion.arm(hand, opening)
    standing = _standing(size, rng)
    bodies = [*_fixtures(), *_links(size, rng)]
    bodies += [(body, meshes) for body, meshes, _, _ in standing]
    names = [body.name for body, _ in bodies]
    others = [n for n in names[names.index("plate") + 1 :] if n not in ("lower", "upper")]
    roles = {
        **ROLES[stage],
        "destination": ("plate",),
        "protected": tuple(others[: size.protected]),
    }
    header = Header(
        episode_id=f"made.{stage.lower()}.{size.frames}.{size.objects}.{size.protected}.{seed}",
        task="made",
        stage=stage,  # type: ignore[arg-type]
        policy="made",
        seed=seed,
        physics_dt=1 / RATE,
        frame_dt=1 / RATE,
        control_dt=1 / 15,
        success=True,
        success_time=float(t[success]),
        termination="success",
        horizon=90.0,
        roles=roles,
        goal="on",
        rules=ASSIGNED[stage],
        force_source="recorded",
        source=Source(recorder="benchmarks/made.py"),
    )
    writer = TraceWriter(header, frames=size.frames)
    for body, meshes in bodies:
        fixed = () if body.movable else ((0.0, 0.0, 0.0),)
        if body.name == "link0":
            fixed = ((SHOULDER[0], 0.0, 0.0),)
        writer.add_body(body, *fixed, meshes=meshes)
    for i in range(7):
        writer.add_joint(Joint(name=f"joint{i + 1}", kind="revolute", body=f"link{i + 1}"))
    for body, _, position, _ in standing:
        p = np.tile(position, (size.frames, 1))
        if body.name == "upper":
            p = motion.carried(position, hand, held)
        jitter = rng.normal(0, 2e-6, p.shape)
        paths[body.name] = p + jitter, Rotation.identity(size.frames)
    movable = [body.name for body, _ in bodies if body.movable]
    poses, twists = motion.tracks([paths[name] for name in movable])
    points, counts = _contacts(writer.header, paths, standing, held, rng)
    ends = np.cumsum(counts)
    rates = np.linspace(0.1, 0.3, 7)  # rad/s
    joints, joint_rates = np.sin(t[:, None] * rates), rates * np.cos(t[:, None] * rates)
    for n, time in enumerate(t.tolist()):
        writer.add_frame(
            time,
            poses[n],
            twists[n],
            contacts=points[ends[n] - counts[n] : ends[n]],
            joint_position=joints[n],
            joint_velocity=joint_rates[n],
            joint_torque=10 * joints[n],
            action=np.append(joints[n - n % 8], opening[n] < 0.5),
            gripper=opening[n],
        )
    return writer


# ---------------------------------------------------------------- what there is

Given = tuple[Body, tuple[Mesh, ...]]
Standing = tuple[Body, tuple[Mesh, ...], F64, int]
"""Body, its meshes, where it stands (m), and its contact points."""


def _fixtures() -> list[Given]:
    table = Geom(kind="box", size=(0.8, 0.6, 0.02), position=(0, 0, -0.02))
    return [(Body(name="table", kind="fixture", movable=False, geoms=(table,)), ())]


def _links(size: Size, rng: np.random.Generator) -> list[Given]:
    """The robot's base, seven links, hand and two fingers; each a convex hull."""
    room = {
        "link0": (0.08, 0.05), "link1": (0.07, 0.08), "link2": (0.06, 0.14), "link3": (0.06, 0.09),
        "link4": (0.055, 0.12), "link5": (0.05, 0.12), "link6": (0.05, 0.05), "link7": (0.04, 0.03),
        "hand": (0.05, 0.03), "left_finger": (0.01, 0.02), "right_finger": (0.01, 0.02),
    }  # fmt: skip
    found: list[Given] = []
    for name, (radius, half) in room.items():
        around = rng.uniform(0, 2 * np.pi, size.vertices)
        height = half * rng.choice([-1.0, 1.0], size.vertices)
        mesh = Mesh.build(
            np.column_stack([radius * np.cos(around), radius * np.sin(around), height])
        )
        finger = name.partition("_")[0] if name.endswith("finger") else None
        body = Body(
            name=name,
            kind="gripper" if finger or name == "hand" else "robot",
            movable=name != "link0",
            mass=1.0,
            finger=finger,  # type: ignore[arg-type]
            geoms=(Geom(kind="convex_mesh", mesh=mesh.key),),
        )
        found.append((body, (mesh,)))
    return found


def _standing(size: Size, rng: np.random.Generator) -> list[Standing]:
    """The objects: a plate, two stacked boxes, and cans, boxes and fruit around their way."""
    box = Geom(kind="box", size=(BOX, BOX, BOX))
    plate = Geom(kind="cylinder", size=(0.09, 0.01))
    up = (0.0, 0.0, 1.0)
    some: list[Standing] = [
        (_object("plate", plate, up), (), np.array([0.10, 0.27, 0.01]), 3),
        (_object("lower", box, up), (), np.array([-0.05, -0.28, BOX]), size.points),
        (_object("upper", box, up), (), np.array([-0.05, -0.28, 3 * BOX]), size.points),
    ]
    rest = size.objects - len(some)
    rows = int(np.ceil(rest / 4))
    places = [(x, y) for y in np.linspace(-0.17, 0.15, rows) for x in (0.02, -0.10, 0.14, 0.26)]
    for i, place in zip(range(rest), places, strict=False):
        x, y = np.array(place) + rng.uniform(-0.01, 0.01, 2)
        if i % 12 == 0:
            geom, height, points = Geom(kind="cylinder", size=(0.03, 0.06)), 0.06, size.points
        elif i % 12 == 6:
            geom, height, points = Geom(kind="box", size=(0.03, 0.02, 0.05)), 0.05, size.points
        else:
            geom, height, points = Geom(kind="ellipsoid", size=(0.03, 0.03, 0.025)), 0.025, 1
        flat = geom.kind != "ellipsoid"
        body = _object(f"object{i}", geom, up if flat else None)
        if size.walls and i < size.protected:
            body, height, points = _mug(f"object{i}", size.walls), 0.045, size.points
        some.append((body, (), np.array([x, y, height]), points))
    return some


def _mug(name: str, walls: int) -> Body:
    """A floor and a wall of boxes in a circle, as the objects of the tasks have it."""
    radius, thin, half = 0.028, 0.002, 0.045
    floor = Geom(kind="cylinder", size=(0.03, thin), position=(0, 0, thin - half))
    wall = [
        Geom(
            kind="box",
            size=(thin, radius * np.tan(np.pi / walls), half - thin),
            position=(radius * np.cos(angle), radius * np.sin(angle), thin),
            orientation=(np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2)),
        )
        for angle in np.arange(walls) * 2 * np.pi / walls
    ]
    up = (0.0, 0.0, 1.0)
    return Body(name=name, kind="object", mass=0.2, up_axis=up, geoms=(floor, *wall))


def _object(name: str, geom: Geom, up: tuple[float, float, float] | None) -> Body:
    return Body(name=name, kind="object", mass=0.2, up_axis=up, geoms=(geom,))


# ---------------------------------------------------------------- what touches


def _contacts(
    header: Header,
    paths: dict[str, tuple[F64, Rotation]],
    standing: list[Standing],
    held: np.ndarray,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray]:
    """All contact points, frame by frame, and how many each frame has (T,)."""
    frames = len(held)
    starts = np.cumsum([0, *(len(body.geoms) for body in header.bodies)])
    geom = {body.name: int(i) for body, i in zip(header.bodies, starts, strict=False)}
    after = np.zeros(frames, bool)
    after[len(held) - int(np.argmax(held[::-1])) :] = True
    blocks: list[tuple[np.ndarray, Any]] = []

    def touch(
        by: str, on: str, where: np.ndarray, points: int, down: float, grip: F64, load: float = 1.0
    ) -> None:
        """``by`` bears ``load`` objects' weight of ``on``, spread over a circle; grip N, horizontal."""
        rows = np.flatnonzero(where)
        position = paths[on][0][rows]
        weight = load * 0.2 * G / points
        inward = grip / np.linalg.norm(grip) if grip.any() else grip
        for k in range(points):
            block = np.zeros(len(rows), POINT)
            angle = 2 * np.pi * (k + 0.5) / points
            corner = np.array([np.cos(angle), np.sin(angle), 0.0]) * (0.02 if points > 1 else 0)
            block["position"] = position + corner - [0, 0, down] - inward * BOX
            noise = rng.normal(0, 0.01 * weight, (len(rows), 3))
            block["force"] = grip + np.array([0.0, 0.0, weight]) + noise
            block["normal"] = inward if grip.any() else (0, 0, 1)
            block["peak_force"] = (weight + np.linalg.norm(grip)) * points * 1.02
            block["depth"] = 1e-4 + rng.normal(0, 1e-6, len(rows))
            block["geom1"], block["geom2"] = geom[by], geom[on]
            blocks.append((rows, block))

    always, none = np.ones(frames, bool), np.zeros(3)
    for body, _, position, points in standing:
        if body.name == "upper":
            touch("lower", "upper", ~held & ~after, points, BOX, none)
            touch("plate", "upper", after, points, BOX, none)
            for finger, side in (("left_finger", -1.0), ("right_finger", 1.0)):
                pads = max(1, points // 4)
                grip = np.array([0.0, 20 * side / pads, 0.0])
                touch(finger, "upper", held, pads, 0.0, grip, load=0.5)
        elif body.name in ("lower", "plate"):  # with the upper box on it, and without
            loaded = after if body.name == "plate" else ~held & ~after
            for where, load in ((~loaded, 1.0), (loaded, 2.0)):
                touch("table", body.name, where, points, float(position[2]), none, load)
        else:
            touch("table", body.name, always, points, float(position[2]), none)
    rows = np.concatenate([block[0] for block in blocks])
    order = np.argsort(rows, kind="stable")
    points_ = np.concatenate([block[1] for block in blocks])[order]
    return points_, np.bincount(rows, minlength=frames)
