"""Robots from files: URDF (wiki.ros.org/urdf/XML) is read here, MJCF by MuJoCo where that is installed."""

from __future__ import annotations

import importlib
import re
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np

from safestage_eval._process import simulator
from safestage_eval.episode import Body, Geom, Mesh
from safestage_eval.errors import InputError, TraceError
from safestage_eval.size_limits import current
from safestage_eval.units import finite

from .guess_words import side_of
from .importer import SourceError
from .mesh_file import read_mesh
from .robot_model import RobotJoint, RobotLink, RobotModel

GRIPPER = re.compile(r"gripper|finger|hand(?!le)|claw|knuckle|robotiq|pad|jaw", re.IGNORECASE)
POSTURES = 24
"""Positions of all joints in which links are tried for overlap."""

JOINTED = ("revolute", "continuous", "prismatic")


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
        current().demand("document", path.stat().st_size, str(path))
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
    links = []
    for link in model.links:
        joined, later = [], False
        for name, mover in movers.items():
            if later and link.body.name in movers:
                pair = [(movers[link.body.name], mover)]
                if (clearance_pairs(pair, POSTURES, 1e-3).lower <= 0).all():
                    joined.append(name)
            later = later or name == link.body.name
        body = link.body.model_copy(update={"excluded": tuple(joined)}) if joined else link.body
        links.append(replace(link, body=body))
    return replace(model, links=tuple(links))


def robot_from_urdf(
    text: str, where: str, folders: tuple[Path, ...] = (), *, hollow: bool = False
) -> RobotModel:
    """Read the one tree of links of a URDF that has joints which move; arguments as of ``read_urdf``.

    Raises:
        TraceError: it is damaged, or has no such tree, or several.
    """
    trees = [tree for tree in read_urdf(text, where, folders, hollow=hollow) if tree.joints]
    if len(trees) != 1:
        names = ", ".join(tree.links[0].body.name for tree in trees[:4])
        raise TraceError(where, f"{len(trees)} links could be the base ({names}).", "one tree of links")  # fmt: skip
    return trees[0]


def read_urdf(
    text: str, where: str, folders: tuple[Path, ...] = (), *, hollow: bool = False
) -> list[RobotModel]:
    """Read all trees of links of a URDF, in the order of their bases.

    Args:
        text: of the description.
        where: for messages.
        folders: in which its meshes are looked for.
        hollow: meshes count as they are, not as their convex hulls.

    Raises:
        TraceError: not XML, numbers that are none, or a document with entities of its own.
    """
    current().demand("document", len(text), where)
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise TraceError(where, "the robot description declares entities.", "plain URDF")
    try:
        urdf = _Urdf(ET.fromstring(text), folders, hollow)  # noqa: S314 — entities are refused above
        return [urdf.tree(name) for name in urdf.links if name not in urdf.above]
    except (ET.ParseError, ValueError) as error:
        raise TraceError(where, f"the robot description is no URDF: {error}.") from None


class _Urdf:
    """Links by name, and the joint above each that hangs on another."""

    def __init__(self, root: ET.Element, folders: tuple[Path, ...], hollow: bool) -> None:
        self._folders, self._hollow = folders, hollow
        self.links = {link.get("name", ""): link for link in root.findall("link")}
        self.above: dict[str, ET.Element] = {}
        for joint in root.findall("joint"):
            ends = [e.get("link") if e is not None else None
                    for e in (joint.find("parent"), joint.find("child"))]  # fmt: skip
            if joint.get("type") not in ("floating", "planar") and {*ends} <= self.links.keys():
                self.above[str(ends[1])] = joint
        self._below: dict[str, list[str]] = {}
        for name in self.links:
            if name in self.above:
                self._below.setdefault(self._parent(name), []).append(name)

    def _parent(self, name: str) -> str:
        parent = self.above[name].find("parent")
        return "" if parent is None else parent.get("link", "")

    def tree(self, base: str) -> RobotModel:
        """The links that hang on one, each after its parent."""
        names, grippers = [base], set[str]()
        links: list[RobotLink] = []
        meshes: dict[str, Mesh] = {}
        lost: list[str] = []
        for name in names:  # grows
            names += self._below.get(name, ())
            if name == base:
                links.append(RobotLink(self._body(name, None, False, meshes, lost)))
                continue
            parent, joint = self._parent(name), _joint(self.above[name])
            if parent in grippers or GRIPPER.search(name):
                grippers.add(name)
            body = self._body(name, parent, name in grippers, meshes, lost)
            links.append(
                RobotLink(body, *_origin(self.above[name]), () if joint is None else (joint,))
            )
        return RobotModel(tuple(links), meshes, tuple(dict.fromkeys(lost)))

    def _body(
        self, name: str, parent: str | None, gripper: bool, meshes: dict[str, Mesh], lost: list[str]
    ) -> Body:
        element, geoms, before = self.links[name], list[Geom](), len(lost)
        shapes = element.findall("collision") or element.findall("visual")
        for shape in shapes:
            for form in shape.iterfind("geometry/*"):
                geom = self._geom(form, *_origin(shape), meshes)
                if geom is None:
                    lost.append(form.get("filename", form.tag))
                else:
                    geoms.append(geom)
        frame = not geoms and len(lost) == before
        if len(lost) > before:  # with a part of its shapes it would seem further away than it is
            geoms = []
        inertial = element.find("inertial")
        mass = None if inertial is None else inertial.find("mass")
        known = None if mass is None else _numbers(mass.get("value"), 1)[0]
        side = side_of(name) if gripper and geoms else None
        return Body(
            name=name,
            kind="gripper" if gripper else "robot",
            mass=0.0 if frame else known,
            com=(0.0, 0.0, 0.0) if inertial is None else _origin(inertial)[0],
            finger=side[0] if side is not None else None,  # type: ignore[arg-type]
            parent=parent,
            geoms=tuple(geoms),
        )

    def _geom(self, form: ET.Element, position: Any, turn: Any, meshes: dict[str, Mesh]) -> Geom | None:  # fmt: skip
        """A shape; None of a mesh that is not found, and of a kind that is not known."""
        place = {"position": position, "orientation": turn}
        if form.tag == "box":
            x, y, z = _numbers(form.get("size"), 3)
            return Geom(kind="box", size=(x / 2, y / 2, z / 2), **place)
        if form.tag == "sphere":
            return Geom(kind="sphere", size=_numbers(form.get("radius"), 1), **place)
        if form.tag in ("cylinder", "capsule"):
            (radius,), (length,) = (_numbers(form.get(key), 1) for key in ("radius", "length"))
            kind: Any = form.tag
            return Geom(kind=kind, size=(radius, length / 2), **place)
        if form.tag != "mesh":
            return None
        scale = _numbers(form.get("scale", "1 1 1"), 3)
        mesh = _mesh(form.get("filename", ""), scale, self._folders, self._hollow)
        if mesh is None:
            return None
        meshes[mesh.key] = mesh
        return Geom(kind="mesh" if self._hollow else "convex_mesh", mesh=mesh.key, **place)


def _joint(element: ET.Element) -> RobotJoint | None:
    """A joint of one degree of freedom; None of others. Raises ValueError for numbers that are none."""
    if element.get("type") not in JOINTED:
        return None
    axis = element.find("axis")
    direction = np.array(_numbers("1 0 0" if axis is None else axis.get("xyz"), 3), np.float64)
    length = float(np.linalg.norm(direction))
    if not length > 0:
        raise ValueError(f"joint {element.get('name')!r} has an axis of no length")
    limit, mimic = element.find("limit"), element.find("mimic")
    limits = follows = None
    if limit is not None and element.get("type") != "continuous" and limit.get("upper"):
        limits = (finite(limit.get("lower", 0)), finite(limit.get("upper", 0)))
    if mimic is not None:
        factor, offset = finite(mimic.get("multiplier", 1)), finite(mimic.get("offset", 0))
        follows = mimic.get("joint", ""), factor, offset
    x, y, z = (direction / length).tolist()
    return RobotJoint(
        element.get("name", ""),
        "prismatic" if element.get("type") == "prismatic" else "revolute",
        (x, y, z),
        limits=limits if limits is not None and limits[0] < limits[1] else None,
        follows=follows,
    )


def _origin(element: ET.Element) -> tuple[Any, Any]:
    """Position (m) and orientation (wxyz) of an element's frame in its parent's."""
    from scipy.spatial.transform import Rotation

    origin = element.find("origin")
    if origin is None:
        return (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)
    rpy = _numbers(origin.get("rpy", "0 0 0"), 3)
    x, y, z, w = Rotation.from_euler("xyz", rpy).as_quat().tolist()
    return _numbers(origin.get("xyz", "0 0 0"), 3), (w, x, y, z)


def _numbers(text: str | None, count: int) -> tuple[Any, ...]:
    """The numbers of an attribute; raise ValueError unless there are ``count``."""
    values = tuple(finite(word) for word in (text or "").split())
    if len(values) != count:
        raise ValueError(f"{text!r} where {count} numbers belong")
    return values


@lru_cache(maxsize=256)
def _mesh(
    file: str, scale: tuple[float, float, float], folders: tuple[Path, ...], hollow: bool
) -> Mesh | None:
    """A mesh file by the longest end of its path that a folder has, in metres; None without, or of a damaged one."""
    from scipy.spatial import ConvexHull, QhullError

    parts = [p for p in re.split(r"[\\/]+", file) if p not in ("", ".", "..", "package:", "file:")]
    paths = (folder.joinpath(*parts[start:]) for start in range(len(parts)) for folder in folders)
    path = next((path for path in paths if path.is_file()), None)
    if path is None:
        return None
    try:
        vertices, faces = read_mesh(path)
        points = vertices * scale
        if hollow:
            return Mesh.build(points, faces)
        return Mesh.build(points[ConvexHull(points).vertices])
    except (InputError, QhullError, ValueError, IndexError):
        return None
