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
from simulate.render.renderer import FOV, Camera, EpisodeRenderer

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
PREFERENCE = 0.15
"""By how much of a body's pixels a direction is preferred to the next pair."""
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
    renderer: EpisodeRenderer,
    bodies: Sequence[str] = (),
    *,
    height: float = 0.0,
    steady: Sequence[int] | None = None,
) -> Camera:
    """An orthographic look, or for ``front`` a perspective one, at everything in the frame.

    Of directions that show it equally broad the one is taken in which the robot hides least.

    Args:
        scene: what is shown.
        view: of ``DIRECTIONS``.
        frames: at which it is to be in the picture.
        size: of the picture.
        renderer: asks what is hidden.
        bodies: others than those that the scene frames.
        height: m that the picture is to have at least.
        steady: frames by which the direction is chosen, if others.
    """
    points = _corners(scene, bodies or scene.framed, frames)
    spread = points if steady is None else _corners(scene, scene.framed, steady)
    elevation = DIRECTIONS[view]
    candidates = _azimuths(scene.episode, view, spread)
    looks = [_fitted(points, azimuth, elevation, size, height, view) for azimuth in candidates]
    if len(looks) == 1:
        return looks[0]
    probe = list(steady or frames)
    probe = probe[:: max(len(probe) // 6, 1)]
    index = scene.episode.body_index
    wanted = [index[name] for name in scene.framed]
    seen = np.array([_seen(renderer, look, probe, wanted) for look in looks])
    share = seen / np.maximum(seen.max(0), 1)
    share[:, [name in scene.roles.get("target", ()) for name in scene.framed]] *= 3
    return looks[int(np.argmax(share.sum(1) - PREFERENCE * (np.arange(len(looks)) // 2)))]


def _seen(
    renderer: EpisodeRenderer, look: Camera, frames: Sequence[int], wanted: Sequence[int]
) -> NDArray[np.int64]:
    """(N,) pixels of each wanted body in the pictures of some frames."""
    owners = np.stack([renderer.owners(frame, look) for frame in frames])
    return np.array([int((owners == body).sum()) for body in wanted])


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


def _azimuths(episode: Episode, view: str, points: F64) -> list[float]:
    """deg: along the robot's reach, or across the line along which things are spread."""
    if view == "top":
        return [90.0]
    base = next((b for b in episode.header.bodies if b.kind == "robot"), None)
    root = episode.tracks[base.name].position[0, :2] if base is not None else np.zeros(2)
    away = points[:, :2].mean(0) - root
    reach = float(np.degrees(np.arctan2(away[1], away[0])))
    if view == "robot":
        return [reach]
    if view == "front":
        return [reach + turn for turn in (140.0, -140.0, 110.0, -110.0)]
    flat = points[:, :2] - points[:, :2].mean(0)
    _, axes = np.linalg.eigh(flat.T @ flat)
    along = float(np.degrees(np.arctan2(axes[1, 1], axes[0, 1])))
    return [along + turn for turn in (90.0, -90.0, 60.0, -60.0, 120.0, -120.0)]


def _fitted(
    points: F64, azimuth: float, elevation: float, size: tuple[int, int], height: float, view: str
) -> Camera:
    """A camera in whose picture all points lie."""
    forward, right, up = axes_of(azimuth, elevation)
    across, rise = points @ right, points @ up
    middle = (
        (across.min() + across.max()) / 2 * right
        + (rise.min() + rise.max()) / 2 * up
        + ((points @ forward).min() + (points @ forward).max()) / 2 * forward
    )
    aspect = size[0] / size[1]
    need = max(
        float(np.ptp(rise)) + 2 * MARGIN,
        (float(np.ptp(across)) + 2 * MARGIN) / aspect,
        SMALLEST,
        height,
    )
    at = (float(middle[0]), float(middle[1]), float(middle[2]))
    if view != "front":
        return Camera(at, 3.0, azimuth, elevation, need)
    slope = np.tan(np.radians(FOV / 2))
    nearer = middle @ forward - points @ forward
    away = np.maximum(
        np.abs(rise - middle @ up) / slope, np.abs(across - middle @ right) / (slope * aspect)
    )
    return Camera(at, max(float((away + nearer).max()) * 1.06, 0.3), azimuth, elevation)


def axes_of(azimuth: float, elevation: float) -> tuple[F64, F64, F64]:
    """Unit vectors forward, right and up of a camera, in the world."""
    a, e = np.radians(azimuth), np.radians(elevation)
    forward = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    right = np.array([np.sin(a), -np.cos(a), 0.0])
    return forward, right, np.cross(right, forward)


def per_metre(camera: Camera, point: F64, height: int) -> float:
    """Pixels that a metre takes across the line of sight at a point (3,) of the world."""
    if camera.height is not None:
        return height / camera.height
    forward, _, _ = axes_of(camera.azimuth, camera.elevation)
    depth = camera.distance + float((point - np.array(camera.at)) @ forward)
    return float(height / 2 / np.tan(np.radians(FOV / 2)) / max(depth, 0.05))
