"""Flat pictures of recorded scenes: what a body's shapes look like from the side or from above."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from safestage_eval.episode import Episode, Geom
from safestage_eval.geometry.pose import matrix
from safestage_eval.palette import INKS, MARK_INK, SERIES, SURFACES

F64 = NDArray[np.float64]
View = Literal["xz", "yz", "xy"]

AXES: dict[View, tuple[int, int, int]] = {"xz": (0, 2, 1), "yz": (1, 2, 0), "xy": (0, 1, 2)}
"""View → the world axes that run right, up, and away from the reader."""

FILLS = tuple(pair.dark for pair in SERIES)
"""Fill colours of objects, in the order of the scene: the palette's lighter ones, on which dark outlines show."""
SOLID, SHEER = 0.9, 0.35
"""How opaque bodies are; what lies in a container is seen through it."""


def surface_points(geom: Geom, episode: Episode) -> F64:
    """(N, 3) m, points in the geom frame whose convex hull is, closely enough, the geom's."""
    size = geom.size
    turn = np.linspace(0, 2 * np.pi, 33)[:-1]
    circle = np.column_stack([np.cos(turn), np.sin(turn)])
    if geom.kind == "box":
        return np.array(np.meshgrid(*[(-s, s) for s in size])).reshape(3, -1).T
    if geom.kind == "cylinder":
        ring = size[0] * circle
        return np.vstack([np.column_stack([ring, np.full(32, z)]) for z in (-size[1], size[1])])
    if geom.kind in ("sphere", "ellipsoid", "capsule"):
        rise = np.linspace(-np.pi / 2, np.pi / 2, 17)
        ball = np.vstack(
            [np.column_stack([np.cos(r) * circle, np.full(32, np.sin(r))]) for r in rise]
        )
        if geom.kind == "ellipsoid":
            return ball * np.array(size)
        ends = (-size[1], size[1]) if geom.kind == "capsule" else (0.0,)
        return np.vstack([size[0] * ball + np.array([0, 0, end]) for end in ends])
    if geom.kind == "plane":
        return np.array(np.meshgrid((-5, 5), (-5, 5), (-0.02, 0))).reshape(3, -1).T
    return np.asarray(episode.meshes[geom.mesh or ""].vertices, float)


def outlines(episode: Episode, body: str, frame: int, view: View) -> list[tuple[float, F64]]:
    """(depth, (K, 2) m polygon) of every geom of a body, as seen in a view."""
    right, up, away = AXES[view]
    track = episode.track(body)
    turn, origin = matrix(track.orientation[frame]), track.position[frame]
    found = []
    for geom in episode.bodies[body].geoms:
        local = surface_points(geom, episode) @ matrix(geom.orientation).T + geom.position
        world = local @ turn.T + origin
        flat = world[:, [right, up]]
        depth = float(world[:, away].mean()) * (1 if view != "xy" else -1)
        found.append((depth, flat[ConvexHull(flat).vertices]))
    return found


def frame_of_interest(
    episode: Episode, frames: Sequence[int], bodies: Sequence[str], view: View
) -> tuple[float, float, float, float]:
    """(left, right, bottom, top) m, around all objects and ``bodies`` in the shown frames."""
    free = [body.name for body in episode.header.bodies if body.kind == "object"]
    free += [name for name in bodies if name not in free]
    points = np.vstack(
        [flat for f in frames for name in free for _, flat in outlines(episode, name, f, view)]
    )
    low, high = points.min(axis=0) - 0.04, points.max(axis=0) + 0.04
    middle, half = (low + high) / 2, (high - low) / 2
    half = np.maximum(half, [half[1] * 1.2, half[0] / 1.2])
    return middle[0] - half[0], middle[0] + half[0], middle[1] - half[1], middle[1] + half[1]


def apart(
    names: Sequence[tuple[str, F64, int]], window: tuple[float, float, float, float]
) -> list[tuple[str, tuple[float, float]]]:
    """Names with places (m) at which none covers another: those in the way go up (1) or down (-1)."""
    line, letter = 0.13 * (window[3] - window[2]), 0.055 * (window[1] - window[0])
    found: list[tuple[str, tuple[float, float]]] = []
    for name, (x, middle), way in sorted(names, key=lambda item: -item[2]):
        y = middle
        while any(
            abs(y - v) < line and abs(x - u) < letter * (len(name) + len(other)) / 2
            for other, (u, v) in found
        ):
            y = y + way * line / 4
        found.append((name, (float(x), float(y))))
    return found


def draw_scene(
    axes: Any,
    episode: Episode,
    frame: int,
    bodies: Sequence[str],
    view: View,
    window: tuple[float, float, float, float],
) -> None:
    """Draw and name bodies at one frame; ``window`` is (left, right, bottom, top) in m."""
    from matplotlib.patches import Polygon

    objects = [b.name for b in episode.header.bodies if b.kind == "object"]
    shapes, names = [], []
    for name in bodies:
        body = episode.bodies[name]
        color = (
            SURFACES[body.kind].light
            if name not in objects
            else FILLS[objects.index(name) % len(FILLS)]
        )
        found = outlines(episode, name, frame, view)
        seen_through = body.cavity is not None
        shapes += [(depth, flat, color, SHEER if seen_through else SOLID) for depth, flat in found]
        if body.kind == "object":
            everything = np.vstack([flat for _, flat in found])
            middle = (everything.min(axis=0) + everything.max(axis=0)) / 2
            names.append((name, middle, -1 if seen_through else 1))
    for _, flat, color, alpha in sorted(shapes, key=lambda s: -s[0]):
        axes.add_patch(
            Polygon(flat, facecolor=color, edgecolor=MARK_INK.light, linewidth=0.6, alpha=alpha)
        )
    for name, (x, y) in apart(names, window):
        axes.annotate(
            name, (x, y), fontsize=6.5, ha="center", va="center", clip_on=True,
            bbox={"boxstyle": "round,pad=0.15", "facecolor": "white", "alpha": 0.75, "linewidth": 0},
        )  # fmt: skip
    axes.set_xlim(window[0], window[1])
    axes.set_ylim(window[2], window[3])
    axes.set_aspect("equal")
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set_visible(True)
        spine.set_color(INKS["line"].light)
