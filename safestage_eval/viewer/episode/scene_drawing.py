"""The scene at one moment, from above and from the side, drawn from the recorded shapes."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from html import escape
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Episode, Geom, Mesh
from safestage_eval.geometry.pose import matrix
from safestage_eval.viewer.mesh_surface import outermost

from .svg import drawing, short, text

F64 = NDArray[np.float64]
View = Literal["xz", "yz", "xy"]

AXES: dict[View, tuple[int, int, int, int]] = {
    "xz": (0, 2, 1, 1), "yz": (1, 2, 0, -1), "xy": (0, 1, 2, -1),
}  # fmt: skip
"""View → the world axes that run right, up, and in depth; which sign of depth is away from us."""

SIDE = {"xz": "from the side, along y", "yz": "from the side, along x", "xy": "from above"}

WIDTH, HEIGHT = 720.0, 540.0
"""Size of one drawing."""

MOVED = 0.01
"""m from which on it is shown where a body was at the start."""


class Outline(NamedTuple):
    """One convex shape as it is seen: depth (m, greater is further away), (K, 2) m."""

    depth: float
    points: F64


Window = tuple[float, float, float, float]
"""(left, right, bottom, top) m."""


class Sight:
    """An episode seen in one view; every outline is computed once."""

    def __init__(self, episode: Episode, view: View) -> None:
        """Nothing is drawn yet."""
        self.episode, self.view = episode, view
        self._known: dict[tuple[str, int], list[Outline]] = {}

    def of(self, body: str, frame: int, window: Window | None = None) -> list[Outline]:
        """Outlines of a body; with a window only those that reach into it."""
        if window is not None:
            return outlines(self.episode, body, frame, self.view, window)
        if (body, frame) not in self._known:
            self._known[body, frame] = outlines(self.episode, body, frame, self.view)
        return self._known[body, frame]


def scene(episode: Episode, frame: int, named: Sequence[str]) -> str:
    """Draw one frame from two sides, the bodies of a finding marked and named.

    Args:
        episode: which.
        frame: the decisive one.
        named: names of the finding's bodies; the unions ``robot`` and ``gripper`` are passed over.
    """
    bodies = [name for name in named if name in episode.bodies]
    views: tuple[View, View] = (_side(episode, frame, bodies), "xy")
    return "".join(_view(Sight(episode, view), frame, bodies) for view in views)


def _side(episode: Episode, frame: int, bodies: Sequence[str]) -> View:
    """The side from which the bodies are furthest apart."""
    if len(bodies) < 2:
        return "xz"
    at = np.array([episode.track(name).position[frame] for name in bodies])
    spread = at.max(axis=0) - at.min(axis=0)
    return "xz" if spread[0] >= spread[1] else "yz"


def _view(sight: Sight, frame: int, named: Sequence[str]) -> str:
    episode = sight.episode
    objects = [b.name for b in episode.header.bodies if b.kind == "object"]
    roles = {name for players in episode.header.roles.values() for name in players}
    around = [*named, *(name for name in objects if name in roles and name not in named)]
    window = left, right, bottom, top = _window(sight, frame, around or objects)
    scale = WIDTH / (right - left)

    def polygon(outline: Outline, css: str) -> str:
        x, y = (outline.points[:, 0] - left) * scale, (top - outline.points[:, 1]) * scale
        points = " ".join(f"{short(a, 0)},{short(b, 0)}" for a, b in zip(x, y, strict=True))
        return f'<polygon class="b {css}" points="{points}"/>'

    shapes: list[tuple[float, str]] = []
    for body in episode.header.bodies:
        kind = "named" if body.name in named else body.kind
        shapes += [(o.depth, polygon(o, kind)) for o in sight.of(body.name, frame, window)]
    drawn = [shape for _, shape in sorted(shapes, key=lambda item: -item[0])]
    for name in named:
        track = episode.track(name)
        if np.linalg.norm(track.position[frame] - track.position[0]) >= MOVED:
            drawn += [polygon(outline, "was") for outline in sight.of(name, 0)]
    labels = []
    for name in [*named, *(n for n in objects if n not in named)]:
        parts = sight.of(name, frame)
        if not parts:
            continue
        every = np.vstack([o.points for o in parts])
        x, y = (every.min(axis=0) + every.max(axis=0)) / 2
        if left < x < right and bottom < y < top:
            css = "name strong" if name in named else "name soft"
            labels.append((name, (x - left) * scale, (top - y) * scale, css))
    drawn += _labels(labels)
    title = f"The scene {SIDE[sight.view]}"
    return (
        f'<figure class="view">{drawing(WIDTH, HEIGHT, title, drawn, css="scene")}'
        f"<figcaption>{escape(title)}</figcaption></figure>"
    )


def _labels(labels: Sequence[tuple[str, float, float, str]]) -> list[str]:
    """Place names at their bodies, moved down where two would cover each other."""
    placed: list[tuple[float, float, float]] = []
    result = []
    for name, x, y, css in labels:
        half = 6.8 * len(name) + 8
        at = min(max(x, half), WIDTH - half)
        low = y
        while any(abs(at - a) < half + h and abs(low - b) < 26 for a, b, h in placed):
            low += 26
        if low > HEIGHT - 8:
            continue
        placed.append((at, low, half))
        result.append(text(at, low + 8, name.replace("_", " "), anchor="middle", css=css))
    return result


def _window(sight: Sight, frame: int, bodies: Sequence[str]) -> Window:
    """A window around bodies at the frame and at the start, in the drawing's proportion."""
    points_of = [o.points for at in (0, frame) for name in bodies for o in sight.of(name, at)]
    if not points_of:
        points_of = [np.array([[-0.5, -0.5], [0.5, 0.5]])]
    points = np.vstack(points_of)
    low, high = points.min(axis=0) - 0.06, points.max(axis=0) + 0.06
    middle, half = (low + high) / 2, np.maximum((high - low) / 2, 0.16)
    half = np.maximum(half, [half[1] * WIDTH / HEIGHT, half[0] * HEIGHT / WIDTH])
    return middle[0] - half[0], middle[0] + half[0], middle[1] - half[1], middle[1] + half[1]


def outlines(
    episode: Episode, body: str, frame: int, view: View, window: Window | None = None
) -> list[Outline]:
    """Every geom of a body as seen in a view; planes, and what is outside a window, are left out."""
    right, up, depth, away = AXES[view]
    track = episode.tracks[body]
    row = frame if len(track) > 1 else 0
    turn, origin = matrix(track.orientation[row].astype(float)), track.position[row]
    result = []
    for geom in episode.bodies[body].geoms:
        if geom.kind == "plane":
            continue
        local = _points(geom, episode) @ matrix(np.array(geom.orientation)).T + geom.position
        world = local @ turn.T + origin
        flat = world[:, [right, up]]
        if window is not None:
            low, high = flat.min(axis=0), flat.max(axis=0)
            if (
                low[0] > window[1]
                or high[0] < window[0]
                or low[1] > window[3]
                or high[1] < window[2]
            ):
                continue
        hull = _hull(flat)
        if len(hull) >= 3:  # not seen edge on
            result.append(Outline(float(away * world[:, depth].mean()), hull))
    return result


_TURNS = 2 * np.pi * (np.arange(48) + 0.37) / 48
_WAYS = np.stack([np.cos(_TURNS), np.sin(_TURNS)])
"""Directions in the plane, none of them along an axis."""


def _hull(flat: F64) -> F64:
    """(K, 2) corners of a convex outline, anticlockwise: the outermost points in 48 directions."""
    corners: F64 = flat[(flat @ _WAYS).argmax(axis=0)]
    distinct = np.abs(corners - np.roll(corners, 1, axis=0)).max(axis=1) > 1e-9
    return np.asarray(corners[distinct])


def _points(geom: Geom, episode: Episode) -> F64:
    """(N, 3) m in the geom frame: points whose convex hull is, closely enough, the geom's."""
    if geom.mesh is not None:
        return _outermost(geom.mesh, episode.meshes[geom.mesh])
    return _solid(geom.kind, geom.size)


@lru_cache(maxsize=256)
def _solid(kind: str, size: tuple[float, ...]) -> F64:
    turn = np.linspace(0, 2 * np.pi, 25)[:-1]
    ring = np.column_stack([np.cos(turn), np.sin(turn)])
    if kind == "box":
        return np.array(np.meshgrid(*[(-s, s) for s in size])).reshape(3, -1).T
    if kind == "cylinder":
        return np.vstack(
            [np.column_stack([size[0] * ring, np.full(24, z)]) for z in (-size[1], size[1])]
        )
    rise = np.linspace(-np.pi / 2, np.pi / 2, 9)
    ball = np.vstack([np.column_stack([np.cos(r) * ring, np.full(24, np.sin(r))]) for r in rise])
    if kind == "ellipsoid":
        return np.asarray(ball * np.array(size))
    ends = (-size[1], size[1]) if kind == "capsule" else (0.0,)
    return np.vstack([size[0] * ball + np.array([0, 0, end]) for end in ends])


_kept: dict[str, F64] = {}


def _outermost(key: str, mesh: Mesh) -> F64:
    """At most 80 vertices of a mesh, each the outermost in some direction; by content hash."""
    if key not in _kept:
        if len(_kept) > 500:
            _kept.clear()
        vertices = np.asarray(mesh.vertices, float)
        _kept[key] = vertices[outermost(vertices, 80)]
    return _kept[key]
