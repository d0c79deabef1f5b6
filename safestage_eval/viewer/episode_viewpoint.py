"""The viewpoint from which an episode is shown."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Body, Episode

ASIDE = np.radians(140)
"""rad from the direction in which the arm reaches to the one in which the camera looks."""
DOWN = np.radians(-25)
"""rad, elevation of the direction of view."""
NEAR, FAR = 0.25, 0.9
"""m, the smallest and the largest radius that is brought into view."""


class Look(NamedTuple):
    """An orbit around a point.

    Attributes:
        at: m, world, what is looked at.
        distance: m from there to the eye.
        azimuth, elevation: rad, of the direction of view; azimuth 0 looks along world x.
    """

    at: tuple[float, float, float]
    distance: float
    azimuth: float
    elevation: float


def look_at(episode: Episode) -> Look:
    """Choose a view of all that happens: of the objects with a role, across the arm's reach.

    Without roles, at all objects that can move; without any, at all bodies but planes.
    """
    some = _shown(episode)
    paths = [episode.tracks[body.name].over(len(episode)).position for body in some]
    points = np.concatenate(paths) if paths else np.zeros((1, 3), np.float32)
    low, high = np.percentile(points, 2, axis=0), np.percentile(points, 98, axis=0)
    at = (low + high) / 2
    across = max((_reach(body, episode) for body in some), default=0.0)
    radius = float(np.clip(np.linalg.norm(high - low) / 2 + across, NEAR, FAR))
    reach = at[:2] - _base(episode)
    forward = float(np.arctan2(reach[1], reach[0])) if reach @ reach > 1e-4 else 0.0
    x, y, z = (round(float(v), 4) for v in (at[0], at[1], at[2] + 0.04))
    return Look((x, y, z), round(2.6 * radius, 4), round(forward + ASIDE, 4), round(DOWN, 4))


def _shown(episode: Episode) -> list[Body]:
    """The bodies that should be in the picture."""
    header = episode.header
    named = {name for names in header.roles.values() for name in names}
    choices = (
        [body for body in header.bodies if body.name in named],
        [body for body in header.bodies if body.kind == "object" and body.movable],
        [body for body in header.bodies if any(geom.kind != "plane" for geom in body.geoms)],
        list(header.bodies),
    )
    return next((bodies for bodies in choices if bodies), [])


def _reach(body: Body, episode: Episode) -> float:
    """m, how far a body's shapes may reach from its origin, planes left out."""
    reaches = [0.0]
    for geom in body.geoms:
        away = float(np.linalg.norm(geom.position))
        if geom.mesh is not None:
            away += float(np.linalg.norm(episode.meshes[geom.mesh].vertices, axis=1).max())
        elif geom.kind != "plane":
            away += max(geom.size) + (geom.size[0] if geom.kind == "capsule" else 0.0)
        reaches.append(away)
    return max(reaches)


def _base(episode: Episode) -> NDArray[np.float64]:
    """(2,) m, world: where the robot stands; the origin without one."""
    for body in episode.header.bodies:
        if body.kind == "robot":
            return np.asarray(episode.tracks[body.name].position[0, :2], np.float64)
    return np.zeros(2)
