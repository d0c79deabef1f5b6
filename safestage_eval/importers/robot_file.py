"""A robot from a file: URDF is read here, MJCF by MuJoCo where that is installed."""

from __future__ import annotations

import importlib
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from safestage_eval._process import simulator
from safestage_eval.episode import Body, Geom, Mesh
from safestage_eval.errors import InputError, TraceError
from safestage_eval.units import finite

from .guess_words import side_of
from .importer import SourceError
from .mesh_file import read_mesh
from .robot_model import RobotJoint, RobotLink, RobotModel
from .urdf_links import JOINTED, Link, MeshShape, numbers_of, origin_of, urdf_links

GRIPPER = re.compile(r"gripper|finger|hand(?!le)|claw|knuckle|robotiq|pad|jaw", re.IGNORECASE)
POSTURES = 24
"""Positions of all joints in which links are tried for overlap."""

LARGEST = 64 << 20
"""bytes of a description."""


@lru_cache(maxsize=4)
def load_robot(path: Path, assets: tuple[Path, ...] = ()) -> RobotModel:
    """Read a robot from URDF or MJCF.

    Args:
        path: of the file; meshes are looked for beside it as it names them.
        assets: further folders in which meshes are looked for by the end of their path.

    Raises:
        SourceError: it cannot be read, is neither, or is MJCF and MuJoCo is not installed.
        TraceError: it is damaged.
    """
    try:
        if path.stat().st_size > LARGEST:
            raise SourceError(str(path), "is larger than 64 MiB: no robot description.")
        text = path.read_text("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise SourceError(str(path), f"cannot be read: {error}.", fix="--robot FILE") from None
    tag = re.search(r"<(robot|mujoco)\b", text)
    if tag is None:
        raise SourceError(
            str(path), "is no robot description.", "URDF (<robot>) or MJCF (<mujoco>)"
        )
    if tag[1] == "robot":
        return without_joined_pairs(robot_from_urdf(text, str(path), (path.parent, *assets)))
    missing = simulator.why_not()
    if missing is not None:
        raise SourceError(str(path), "is MJCF, which MuJoCo reads.", "URDF without it", missing)
    module = importlib.import_module(f"{simulator.NAME}.importers.robot_mjcf")
    model: RobotModel = module.robot_from_mjcf(path)
    return model


def without_joined_pairs(model: RobotModel) -> RobotModel:
    """Return the model whose links exclude those that they overlap wherever the joints are.

    The hulls of links two joints apart often do, by design; a URDF does not say so. Each pair is looked at in
    positions of the joints all over their ranges.
    """
    from safestage_eval.geometry.group_clearance import clearance_pairs
    from safestage_eval.geometry.mover import Mover
    from safestage_eval.geometry.shape import BodyShape

    draw = np.random.default_rng(0)
    ranges = {joint.name: joint.limits or (-np.pi, np.pi) for joint in model.joints}
    positions = {name: draw.uniform(*limits, POSTURES) for name, limits in ranges.items()}
    base = np.zeros((POSTURES, 3)), np.tile([1.0, 0, 0, 0], (POSTURES, 1))
    movers = {
        link.body.name: Mover.build(BodyShape.build(link.body, model.meshes), *(
            np.broadcast_to(part, (POSTURES, part.shape[1])) for part in poses
        ))
        for link, poses in zip(model.links, model.place(base, positions).values(), strict=True)
        if link.body.geoms
    }  # fmt: skip
    names = [*movers]
    joined: dict[str, list[str]] = {name: [] for name in names}
    for i, one in enumerate(names):
        for other in names[i + 1 :]:
            apart = clearance_pairs([(movers[one], movers[other])], POSTURES, 1e-3)
            if (apart.lower <= 0).all():
                joined[one].append(other)
    links = (
        replace(link, body=link.body.model_copy(update={"excluded": tuple(joined[link.body.name])}))
        if joined.get(link.body.name)
        else link
        for link in model.links
    )
    return replace(model, links=tuple(links))


def robot_from_urdf(
    text: str, where: str, folders: Sequence[Path] = (), *, hollow: bool = False
) -> RobotModel:
    """Read a robot, or furniture, from the text of a URDF.

    Args:
        text: of the description.
        where: for messages.
        folders: in which its meshes are looked for.
        hollow: meshes count as they are, not as their convex hulls.

    Raises:
        TraceError: it is damaged, has no joint that moves, or no single base.
    """
    links = urdf_links(text, where)
    root = ET.fromstring(text)  # noqa: S314 — urdf_links refuses entities
    places: dict[str, tuple[dict[str, tuple[float, ...]], RobotJoint | None]] = {}
    try:
        for joint in root.findall("joint"):
            child = joint.find("child")
            if child is not None:
                places[child.get("link", "")] = origin_of(joint), _joint(joint)
    except ValueError as error:
        raise TraceError(where, f"the robot description is no URDF: {error}.") from None
    moving = {name for name, (_, joint) in places.items() if joint is not None}
    bases = [
        name
        for name, link in links.items()
        if link.parent is None and _carries(name, links, moving)
    ]
    if len(bases) != 1:
        raise TraceError(
            where, f"{len(bases)} links could be the base ({', '.join(bases[:4])}).", "one tree of links"
        )  # fmt: skip
    meshes: dict[str, Mesh] = {}
    lost: list[str] = []
    tree = [RobotLink(_body(bases[0], links, places, folders, meshes, lost, hollow))]
    names = [bases[0]]
    for parent in names:  # grows
        for name, link in links.items():
            if link.parent == parent and name in places and name not in names:
                origin, moved = places[name]
                names.append(name)
                body = _body(name, links, places, folders, meshes, lost, hollow)
                joints = () if moved is None else (moved,)
                tree.append(RobotLink(body, origin["position"], origin["orientation"], joints))  # type: ignore[arg-type]
    return RobotModel(tuple(tree), meshes, tuple(dict.fromkeys(lost)))


def _joint(element: ET.Element) -> RobotJoint | None:
    """A joint of one degree of freedom; None of others. Raises ValueError for numbers that are none."""
    if element.get("type") not in JOINTED:
        return None
    axis = element.find("axis")
    direction = np.array(numbers_of("1 0 0" if axis is None else axis.get("xyz"), 3), np.float64)
    length = float(np.linalg.norm(direction))
    if not length > 0:
        raise ValueError(f"joint {element.get('name')!r} has an axis of no length")
    limit, mimic = element.find("limit"), element.find("mimic")
    limits = None
    if limit is not None and element.get("type") != "continuous" and limit.get("upper"):
        limits = (finite(limit.get("lower", 0)), finite(limit.get("upper", 0)))
    follows = None
    if mimic is not None:
        follows = (
            mimic.get("joint", ""), finite(mimic.get("multiplier", 1)), finite(mimic.get("offset", 0))
        )  # fmt: skip
    x, y, z = (direction / length).tolist()
    return RobotJoint(
        element.get("name", ""),
        "prismatic" if element.get("type") == "prismatic" else "revolute", (x, y, z),
        limits=limits if limits is not None and limits[0] < limits[1] else None, follows=follows,
    )  # fmt: skip


def _carries(name: str, links: Mapping[str, Link], moving: set[str]) -> bool:
    """Whether a joint that moves hangs somewhere on a link."""
    below, names = [name], {name}
    for one in below:  # grows
        more = [n for n, link in links.items() if link.parent == one and n not in names]
        below += more
        names |= {*more}
    return bool(names & moving)


def _body(
    name: str,
    links: Mapping[str, Link],
    places: Mapping[str, object],
    folders: Sequence[Path],
    meshes: dict[str, Mesh],
    lost: list[str],
    hollow: bool,
) -> Body:
    link, above, gripper = links[name], name, False
    while above and not gripper:
        gripper = bool(GRIPPER.search(above)) and above in places
        above = links[above].parent or ""
    geoms, before = [*link.geoms], len(lost)
    for shape in link.meshes:
        mesh = _mesh(shape, folders, hollow)
        if mesh is None:
            lost.append(shape.file)
            continue
        meshes[mesh.key] = mesh
        geoms.append(
            Geom(
                kind="mesh" if hollow else "convex_mesh",
                mesh=mesh.key,
                position=shape.position,
                orientation=shape.orientation,
            )
        )
    if len(lost) > before:  # with a part of its shapes it would seem further away than it is
        geoms = []
    side = side_of(name) if gripper else None
    frame = not geoms and not link.meshes
    return Body(
        name=name,
        kind="gripper" if gripper else "robot",
        mass=0.0 if frame else link.mass,
        com=link.com,
        finger=side[0] if side is not None and geoms else None,  # type: ignore[arg-type]
        parent=link.parent,
        geoms=tuple(geoms),
    )


def _mesh(shape: MeshShape, folders: Sequence[Path], hollow: bool) -> Mesh | None:
    """The points of a mesh file in metres; None if it is not there or cannot be read."""
    parts = [
        p for p in re.split(r"[\\/]+", shape.file) if p not in ("", ".", "..", "package:", "file:")
    ]
    for start in range(len(parts)):
        for folder in folders:
            path = folder.joinpath(*parts[start:])
            if path.is_file():
                return _points(path, shape.scale, hollow)
    return None


@lru_cache(maxsize=256)
def _points(path: Path, scale: tuple[float, float, float], hollow: bool) -> Mesh | None:
    from scipy.spatial import ConvexHull, QhullError

    try:
        vertices, faces = read_mesh(path)
        points = vertices * scale
        if hollow:
            return Mesh.build(points, faces)
        return Mesh.build(points[ConvexHull(points).vertices])
    except (InputError, QhullError, ValueError, IndexError):
        return None
