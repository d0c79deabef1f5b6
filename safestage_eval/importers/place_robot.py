"""The links of a robot whose recording has its joints alone, placed by its description (``--robot``)."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Body, Joint, Mesh, Track

from .account import Account
from .foreign_motion import fixed_if_still, make_track
from .importer import Settings, SourceError
from .map_tables import MapFile
from .robot_file import load_robot
from .robot_model import RobotModel, match_joints, opening
from .scene_bodies import apply_map

F64 = NDArray[np.float64]

JOINTED = "jointed"
"""Tag of the links that joints move; the others are one with the base."""


@dataclass(frozen=True)
class Placed:
    """A robot's links over time.

    Attributes:
        bodies: the base first, under the name that it was given.
        tracks: of all of them.
        joints: of the recorded columns, in their order.
        columns: (T, n) the recorded joint positions, rad or m.
        unit: (n,) rad or m for one of what the columns are in.
        gripper: (T, 1) how far it is open, 0 … 1; (T, 0) where its fingers do not tell.
    """

    bodies: list[Body]
    tracks: dict[str, Track]
    joints: tuple[Joint, ...]
    columns: F64
    unit: F64
    gripper: F64


def place_robot(
    settings: Settings,
    base: str,
    motion: Track,
    columns: F64,
    account: Account,
    meshes: dict[str, Mesh],
    *,
    names: Sequence[str] = (),
    taken: Collection[str] = (),
) -> Placed | None:
    """Place all links of the robot that the user named; None without one.

    Args:
        settings: with ``robot``, and perhaps the map file's ``[robot]``.
        base: name of the body that is its first link.
        motion: of that body, T frames or one.
        columns: (T, n) recorded joint positions, rad or m unless the map's ``[robot]`` says otherwise.
        account: for remarks.
        meshes: receives those of its shapes.
        names: of the columns, as far as the source has any.
        taken: names of other bodies of the scene.

    Raises:
        SourceError: the columns are not those of its joints, or the file cannot be read.
    """
    if settings.robot is None:
        return None
    model = load_robot(settings.robot, settings.assets)
    chosen = settings.map.robot.joints
    matched = match_joints(model, names, columns.shape[1], chosen)
    if matched is None:
        raise SourceError(
            str(settings.robot),
            f"its joints ({', '.join(joint.name for joint in model.layers())}) are not those of the "
            f"{columns.shape[1]} recorded columns{' (' * bool(names)}{', '.join(names)}{')' * bool(names)}.",
            fix='[robot] joints = ["…", …] in the map file, a name for each column in order; or another --robot',
        )
    if not chosen and set(matched) != set(names):
        account.guessed(
            f"order of the joints of {base}", f"{', '.join(matched)}, breadth first as in {settings.robot.name}",
            cost="with another order its links are elsewhere", remedy="[robot] joints in the map file",
        )  # fmt: skip
    account.recomputed(
        f"poses of the links of {base}", f"from its joints, by {settings.robot.name}",
        cost="velocities are differences of the poses",
    )  # fmt: skip
    if model.lost:
        account.missing(
            f"{len(model.lost)} meshes of {base}", ", ".join(model.lost[:3]),
            cost="clearances of these links: inconclusive", remedy="--assets DIR, a folder that has them",
        )  # fmt: skip
    unit = _units(settings, model, matched, columns)
    positions = {name: unit[i] * columns[:, i] for i, name in enumerate(matched)}
    meshes.update(model.meshes)
    placed = placed_links(model, base, motion, positions, matched, settings.map, meshes, taken)
    return replace(placed, unit=unit)


def _units(settings: Settings, model: RobotModel, matched: Sequence[str], columns: F64) -> F64:
    """(n,) rad or m for one of what each column is in.

    Raises:
        SourceError: joints that turn have angles of more than two turns, and nobody said in which unit.
    """
    kinds = {joint.name: joint.kind for joint in model.joints}
    turns = np.array([kinds[name] == "revolute" for name in matched])
    unit, largest = settings.map.robot.angle, float(np.nanmax(np.abs(columns[:, turns]), initial=0))
    if unit is None and largest > 4 * np.pi:
        raise SourceError(
            str(settings.robot),
            f"its joints would turn by up to {largest:.4g} rad, more than two turns: the recorded columns "
            "are in degrees, or in a unit of the drives.",
            fix='[robot] angle = "deg" in the map file; "rad" if they do turn so far',
        )
    return np.where(turns & (unit == "deg"), np.pi / 180, 1.0)


def placed_links(
    model: RobotModel,
    base: str,
    motion: Track,
    positions: dict[str, F64],
    matched: Sequence[str],
    map_: MapFile,
    meshes: dict[str, Mesh],
    taken: Collection[str],
) -> Placed:
    """Place the links of a model by ``positions``, joint → (T,); the other arguments as ``place_robot``."""
    length = len(next(iter(positions.values())))
    start = motion.position.astype(np.float64), motion.orientation.astype(np.float64)
    poses = model.place(start, positions)
    root = model.links[0].body.name
    called = {
        link.body.name: f"{base}_{link.body.name}" if link.body.name in taken else link.body.name
        for link in model.links
    } | {root: base}
    bodies: list[Body] = []
    tracks: dict[str, Track] = {}
    jointed: set[str] = set()
    for link in model.links:
        if link.joints or link.body.parent in jointed:
            jointed.add(link.body.name)
        name = called[link.body.name]
        parent = None if link.body.parent is None else called.get(link.body.parent)
        body = apply_map(
            link.body.model_copy(update={
                "name": name, "parent": parent,
                "excluded": tuple(called[other] for other in link.body.excluded if other in called),
                "tags": (*link.body.tags, *([JOINTED] if link.body.name in jointed else ())),
            }), map_, meshes
        )  # fmt: skip
        if name == base:
            body, track = (body, motion) if len(motion) > 1 else (
                body.model_copy(update={"movable": False}), motion
            )  # fmt: skip
        else:
            place, turn = (
                np.broadcast_to(part, (length, part.shape[-1])) for part in poses[link.body.name]
            )
            body, track = fixed_if_still(body, make_track(place, turn, None, None))
        bodies.append(body)
        tracks[name] = track
    moved = {
        joint.name: (called[link.body.name], joint) for link in model.links for joint in link.joints
    }
    joints = tuple(
        Joint(
            name=name, kind=moved[name][1].kind, body=moved[name][0], limits=moved[name][1].limits
        )
        for name in matched
    )
    open_ = opening(model, positions)
    return Placed(
        bodies,
        tracks,
        joints,
        np.stack([positions[name] for name in matched], axis=1),
        np.ones(len(matched)),
        np.zeros((length, 0)) if open_ is None else open_[:, None],
    )
