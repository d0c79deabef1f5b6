"""A URDF of all bodies, so that viewers without scene updates show their shapes."""

from __future__ import annotations

from collections.abc import Iterator
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import numpy as np

from safestage_eval.episode import Episode, Geom
from safestage_eval.episode.scene_shapes import rotation_matrix

PLANE_SIZE = 4.0
"""m, edge of the square that stands for an unbounded plane."""

COLOURS = {
    "robot": (0.55, 0.57, 0.60, 1.0),
    "gripper": (0.25, 0.27, 0.30, 1.0),
    "object": (0.85, 0.55, 0.20, 1.0),
    "fixture": (0.75, 0.72, 0.66, 1.0),
    "region": (0.30, 0.60, 0.90, 0.25),
}
"""Kind of body → r, g, b, a in viewers."""


def to_urdf(episode: Episode) -> str:
    """Return a URDF with one link per body on floating joints, moved by the transforms of ``/tf``.

    Spheres, boxes and cylinders are exact, a capsule is a cylinder between two spheres, an
    ellipsoid is a sphere of the mean radius and a mesh its bounding box: URDF has no others
    without further files.
    """
    robot = Element("robot", name="safestage")
    SubElement(robot, "link", name="world")
    for body in episode.header.bodies:
        link = SubElement(robot, "link", name=body.name)
        colour = " ".join(f"{value:g}" for value in COLOURS[body.kind])
        for geom in body.geoms:
            for shape, offset in _shapes(geom, episode):
                visual = SubElement(link, "visual")
                rotation = rotation_matrix(geom.orientation)
                xyz = np.asarray(geom.position) + rotation @ offset
                SubElement(visual, "origin", xyz=_text(xyz), rpy=_text(roll_pitch_yaw(rotation)))
                SubElement(visual, "geometry").append(shape)
                material = SubElement(visual, "material", name=body.kind)
                SubElement(material, "color", rgba=colour)
        joint = SubElement(robot, "joint", name=f"world_to_{body.name}", type="floating")
        SubElement(joint, "parent", link="world")
        SubElement(joint, "child", link=body.name)
    indent(robot)
    return '<?xml version="1.0"?>\n' + tostring(robot, encoding="unicode") + "\n"


def _shapes(geom: Geom, episode: Episode) -> Iterator[tuple[Element, np.ndarray]]:
    size, here = geom.size, np.zeros(3)
    match geom.kind:
        case "sphere":
            yield _sphere(size[0]), here
        case "ellipsoid":
            yield _sphere(sum(size) / 3), here
        case "box":
            yield _box(2 * np.asarray(size)), here
        case "cylinder":
            yield _cylinder(size[0], 2 * size[1]), here
        case "capsule":
            yield _cylinder(size[0], 2 * size[1]), here
            for end in (-size[1], size[1]):
                yield _sphere(size[0]), np.array([0, 0, end])
        case "plane":
            yield _box(np.array([PLANE_SIZE, PLANE_SIZE, 1e-3])), np.array([0, 0, -5e-4])
        case "mesh" | "convex_mesh":
            vertices = episode.meshes[geom.mesh or ""].vertices.astype(float)
            low, high = vertices.min(0), vertices.max(0)
            yield _box(high - low), (low + high) / 2


def _sphere(radius: float) -> Element:
    return Element("sphere", radius=f"{radius:.6g}")


def _box(size: np.ndarray) -> Element:
    return Element("box", size=_text(size))


def _cylinder(radius: float, length: float) -> Element:
    return Element("cylinder", radius=f"{radius:.6g}", length=f"{length:.6g}")


def _text(values: np.ndarray) -> str:
    return " ".join(f"{value:.6g}" for value in values)


def roll_pitch_yaw(rotation: np.ndarray) -> np.ndarray:
    """Return URDF's (3,) angles in rad about the fixed axes x, y, z: R = Rz(yaw) Ry(pitch) Rx(roll)."""
    pitch = np.arcsin(np.clip(-rotation[2, 0], -1, 1))
    if abs(rotation[2, 0]) > 1 - 1e-9:  # straight up or down: yaw and roll are one
        return np.array([np.arctan2(-rotation[1, 2], rotation[1, 1]), pitch, 0.0])
    roll = np.arctan2(rotation[2, 1], rotation[2, 2])
    return np.array([roll, pitch, np.arctan2(rotation[1, 0], rotation[0, 0])])
