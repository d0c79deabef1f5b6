"""Choice of bodies, colours and viewpoint for pictures of an episode."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Body, Episode
from safestage_eval.geometry.pose import matrix
from safestage_eval.geometry.shape import BodyShape
from safestage_eval.palette import PAINTS, fractions
from simulate.render.marks import Color
from simulate.render.renderer import Camera

F64 = NDArray[np.float64]

COLORS: dict[str, Color] = {role: fractions(paint) for role, paint in PAINTS.items()}
"""Role → colour; the first role that a body plays counts."""
OTHER_ROLE: Color = (0.60, 0.35, 0.75)
OBJECT: Color = (0.78, 0.78, 0.72)
FIXTURE: Color = (0.80, 0.72, 0.60)
LINKS, HAND = 0.22, 0.7
"""Opacity of the arm's links, and of the gripper …"""
LINKS_ABOVE, HAND_ABOVE = 0.1, 0.3
"""… and seen from above, where they stand in the way."""
MARGIN = 0.04
"""m around what is framed."""
SMALLEST = 0.16
"""m, the least height of a picture."""
FALLEN = 0.25
"""m below its start, from which on a body does not widen the frame."""
DIRECTIONS = {"front": -25.0, "robot": -30.0, "side": -4.0, "top": -89.0}
"""View → elevation, deg."""


@dataclass(frozen=True)
class Scene:
    """The part of an episode that is shown.

    Attributes:
        episode: which.
        roles: role → bodies.
        framed: bodies that are to be in the picture: those with a role, and objects that move.
    """

    episode: Episode
    roles: Mapping[str, Sequence[str]]
    framed: tuple[str, ...]

    @classmethod
    def of(cls, episode: Episode, roles: Mapping[str, Sequence[str]]) -> Scene:
        """Find what moves. Raises TraceError when poses are broken."""
        named = {body for bodies in roles.values() for body in bodies}
        framed = tuple(
            body.name
            for body in episode.header.bodies
            if body.geoms and (body.name in named or (_free(body) and _travels(episode, body)))
        )
        return cls(episode, roles, framed)

    @property
    def colors(self) -> dict[str, Color]:
        """Body → colour: that of its role, or a pale one. Several of a role differ in shade."""
        result: dict[str, Color] = {}
        for role, bodies in self.roles.items():
            base = COLORS.get(role, OTHER_ROLE)
            for i, name in enumerate(name for name in bodies if name not in result):
                result[name] = _shaded(base, i)
        for body in self.episode.header.bodies:
            if body.kind in ("object", "fixture") and body.name not in result:
                result[body.name] = OBJECT if body.movable else FIXTURE
        return result

    def opacity(self, view: str) -> dict[str, float]:
        """Body → how solid it is in a view: the arm is seen through, the gripper a little."""
        links, hand = (LINKS_ABOVE, HAND_ABOVE) if view == "top" else (LINKS, HAND)
        kinds = {"robot": links, "gripper": hand}
        return {b.name: kinds[b.kind] for b in self.episode.header.bodies if b.kind in kinds}


def camera_of(
    scene: Scene,
    view: str,
    frames: Sequence[int],
    size: tuple[int, int],
    bodies: Sequence[str] = (),
    *,
    height: float = 0.0,
    steady: Sequence[int] | None = None,
) -> Camera:
    """An orthographic look at everything in the frame.

    Args:
        scene: what is shown.
        view: of ``DIRECTIONS``.
        frames: at which it is to be in the picture.
        size: of the picture.
        bodies: others than those that the scene frames.
        height: m that the picture is to have at least.
        steady: frames by which the direction is chosen, if others.
    """
    points = _corners(scene, bodies or scene.framed, frames)
    spread = points if steady is None else _corners(scene, scene.framed, steady)
    azimuth, elevation = _azimuth(scene.episode, view, spread), DIRECTIONS[view]
    a, e = np.radians(azimuth), np.radians(elevation)
    forward = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    right = np.array([np.sin(a), -np.cos(a), 0.0])
    axes = np.stack([right, np.cross(right, forward), forward])
    seen = points @ axes.T
    middle = (seen.min(axis=0) + seen.max(axis=0)) / 2 @ axes
    across, rise, _ = np.ptp(seen, axis=0) + 2 * MARGIN
    need = max(float(rise), float(across) * size[1] / size[0], SMALLEST, height)
    return Camera(
        (float(middle[0]), float(middle[1]), float(middle[2])), 3.0, azimuth, elevation, need
    )


def _free(body: Body) -> bool:
    return body.kind == "object" and body.movable


def _travels(episode: Episode, body: Body) -> bool:
    position = episode.tracks[body.name].position
    return bool((np.ptp(position, axis=0) > 0.005).any())


def _shaded(color: Color, i: int) -> Color:
    factor = (1.0, 0.72, 1.3, 0.55)[i % 4]
    red, green, blue = (min(1.0, part * factor + (0.1 if factor > 1 else 0.0)) for part in color)
    return red, green, blue


_CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float64)


def near(episode: Episode, name: str) -> float:
    """m, of a picture that shows a body and as much about it."""
    half = BodyShape.build(episode.bodies[name], episode.meshes).half
    size = float(np.linalg.norm(half[np.isfinite(half)]))
    return max(SMALLEST, 3.2 * size)


def _corners(scene: Scene, names: Iterable[str], frames: Sequence[int]) -> F64:
    """(N, 3) m, world: corners of the boxes around bodies at some frames."""
    episode, corners = scene.episode, [np.zeros((0, 3))]
    for name in names:
        shape = BodyShape.build(episode.bodies[name], episode.meshes)
        if not np.isfinite(shape.half).all():
            continue
        track = episode.tracks[name].over(len(episode))
        low = float(track.position[0, 2]) - FALLEN
        kept = [frame for frame in frames if track.position[frame, 2] >= low] or [frames[0]]
        turns, places = matrix(track.orientation[kept]), track.position[kept].astype(np.float64)
        local = shape.centre + _CORNERS * shape.half
        corners.append((np.einsum("tij,cj->tci", turns, local) + places[:, None]).reshape(-1, 3))
    points = np.concatenate(corners)
    return points if len(points) else np.zeros((1, 3))


def _azimuth(episode: Episode, view: str, points: F64) -> float:
    """deg: by the robot's reach, or across the line along which things are spread."""
    if view == "top":
        return 90.0
    if view == "side":
        flat = points[:, :2] - points[:, :2].mean(0)
        _, axes = np.linalg.eigh(flat.T @ flat)
        return float(np.degrees(np.arctan2(axes[1, 1], axes[0, 1]))) + 90.0
    base = next((b for b in episode.header.bodies if b.kind == "robot"), None)
    root = episode.tracks[base.name].position[0, :2] if base is not None else np.zeros(2)
    away = points[:, :2].mean(0) - root
    reach = float(np.degrees(np.arctan2(away[1], away[0])))
    return reach if view == "robot" else reach + 140.0
