"""Links of a URDF: shapes, masses, and which of them make up a robot (wiki.ros.org/urdf/XML)."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any
from xml.etree import ElementTree as ET

from safestage_eval.episode import Geom
from safestage_eval.episode.body import GeomKind
from safestage_eval.errors import TraceError
from safestage_eval.size_limits import current
from safestage_eval.units import finite

JOINTED = ("revolute", "continuous", "prismatic")


@dataclass(frozen=True)
class MeshShape:
    """A mesh file of a link: its place (m, wxyz) in the link's frame, and m per unit along each axis."""

    file: str
    position: tuple[float, float, float]
    orientation: tuple[float, float, float, float]
    scale: tuple[float, float, float]


@dataclass(frozen=True)
class Link:
    """One link.

    Attributes:
        geoms: of its collision shapes, or of its visual ones where it has no others.
        mass: kg; None if it has no inertial part.
        com: m, in the link's frame.
        robot: it hangs on the same tree as a joint that moves.
        left_out: mesh files, which are not opened.
        meshes: the same, with their place in the link's frame and their scale.
        parent: link that it is jointed to; None for the root.
    """

    geoms: tuple[Geom, ...] = ()
    mass: float | None = None
    com: tuple[float, float, float] = (0.0, 0.0, 0.0)
    robot: bool = False
    left_out: tuple[str, ...] = field(default=())
    parent: str | None = None
    meshes: tuple[MeshShape, ...] = ()


def urdf_links(text: str, where: str) -> dict[str, Link]:
    """Return link name → the link of the description.

    Raises:
        TraceError: not XML, numbers that are none, or a document with entities of its own.
    """
    current().demand("document", len(text), where)
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise TraceError(where, "the robot description declares entities.", "plain URDF")
    try:
        root = ET.fromstring(text)  # noqa: S314 — entities are refused above
        parents, jointed = _joints(root)
        return {
            name: _link(element, jointed(name), parents.get(name))
            for element in root.findall("link")
            if (name := element.get("name"))
        }
    except (ET.ParseError, ValueError) as error:
        raise TraceError(where, f"the robot description is no URDF: {error}.") from None


def _joints(root: ET.Element) -> tuple[dict[str, str], Any]:
    """Child → parent of all joints that hold; and whether a link's tree has one that moves."""
    parents, moving = {}, set()
    for joint in root.findall("joint"):
        parent, child = joint.find("parent"), joint.find("child")
        if parent is None or child is None or joint.get("type") in ("floating", "planar"):
            continue
        parents[child.get("link", "")] = parent.get("link", "")
        if joint.get("type") in JOINTED:
            moving.add(child.get("link", ""))

    ends: dict[str, str] = {}

    def base(name: str) -> str:
        seen = set()
        while name in parents and name not in seen and name not in ends:
            seen.add(name)
            name = parents[name]
        end = ends.get(name, name)
        ends.update(dict.fromkeys(seen, end))
        return end

    bases = {base(name) for name in moving}
    return parents, lambda name: base(name) in bases


def _link(element: ET.Element, robot: bool, parent: str | None) -> Link:
    shapes = element.findall("collision") or element.findall("visual")
    geoms, left_out, meshes = [], [], []
    for shape in shapes:
        geometry = shape.find("geometry")
        for form in geometry if geometry is not None else ():
            place = origin_of(shape)
            if form.tag == "box":
                x, y, z = numbers_of(form.get("size"), 3)
                geoms.append(Geom(kind="box", size=(x / 2, y / 2, z / 2), **place))
            elif form.tag == "sphere":
                geoms.append(Geom(kind="sphere", size=numbers_of(form.get("radius"), 1), **place))
            elif form.tag in ("cylinder", "capsule"):
                (radius,) = numbers_of(form.get("radius"), 1)
                (length,) = numbers_of(form.get("length"), 1)
                kind: GeomKind = "cylinder" if form.tag == "cylinder" else "capsule"
                geoms.append(Geom(kind=kind, size=(radius, length / 2), **place))
            else:
                if form.tag == "mesh":
                    scale = numbers_of(form.get("scale", "1 1 1"), 3)
                    meshes.append(
                        MeshShape(
                            form.get("filename", ""), place["position"], place["orientation"], scale
                        )
                    )
                left_out.append(form.get("filename", form.tag))
    inertial = element.find("inertial")
    mass = None if inertial is None else inertial.find("mass")
    return Link(
        tuple(geoms),
        None if mass is None else numbers_of(mass.get("value"), 1)[0],
        (0.0, 0.0, 0.0) if inertial is None else origin_of(inertial)["position"],
        robot,
        tuple(left_out),
        parent,
        tuple(meshes),
    )


def origin_of(element: ET.Element) -> dict[str, Any]:
    """Position (m) and orientation (wxyz) of an element's frame in its parent's."""
    from scipy.spatial.transform import Rotation

    origin = element.find("origin")
    if origin is None:
        return {"position": (0.0, 0.0, 0.0), "orientation": (1.0, 0.0, 0.0, 0.0)}
    rpy = numbers_of(origin.get("rpy", "0 0 0"), 3)
    x, y, z, w = Rotation.from_euler("xyz", rpy).as_quat().tolist()
    return {"position": numbers_of(origin.get("xyz", "0 0 0"), 3), "orientation": (w, x, y, z)}


def numbers_of(text: str | None, count: int) -> tuple[Any, ...]:
    """The numbers of an attribute; raise ValueError unless there are ``count``."""
    values = tuple(finite(word) for word in (text or "").split())
    if len(values) != count:
        raise ValueError(f"{text!r} where {count} numbers belong")
    return values
