"""The scene of stored episodes: most of a task have the same bodies, which are understood once."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from safestage_eval.episode import Body, Header, Joint
from safestage_eval.formats.contact_points import GeomNames

from .episode_row import mesh_keys

_KEPT = 8


class Scene(NamedTuple):
    """The bodies and shapes that episodes share.

    Attributes:
        text: its bodies and joints as they are stored.
        shapes: rows of ``geometry``.
        bodies, joints: the same, understood.
        places: name → index among them.
        owner: (G,) index of each geom's body.
        meshes: keys of the meshes that geoms have, each once.
        sound: they were checked, and nothing was wrong with them; else nobody looked yet.
    """

    text: tuple[object, object]
    shapes: pa.Table
    bodies: tuple[Body, ...]
    joints: tuple[Joint, ...]
    places: dict[str, int]
    owner: NDArray[np.int16]
    meshes: list[str]
    sound: bool


_SCENES: list[Scene] = []
"""Those that were met last."""


def find_scene(text: tuple[object, object], shapes: pa.Table) -> Scene | None:
    """Return the scene with these bodies, joints and rows of ``geometry``; None if it was not met lately."""
    for scene in _SCENES:
        if scene.text == text and scene.shapes.equals(shapes):
            return scene
    return None


def make_scene(
    text: tuple[object, object], shapes: pa.Table, header: Header, *, sound: bool
) -> Scene:
    """Make the scene of a header, and keep it. ``sound``: as in ``Scene``."""
    index = {body.name: i for i, body in enumerate(header.bodies)}
    owner = GeomNames(header).owner
    keys = mesh_keys(header)
    scene = Scene(text, shapes, header.bodies, header.joints, index, owner, keys, sound)
    _SCENES[:] = [scene, *(other for other in _SCENES if other.bodies is not scene.bodies)][:_KEPT]
    return scene
