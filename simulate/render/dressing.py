"""Meshes and paint on the bodies of a trace, where it is SafeStage's own recording of catalogue objects."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np

from safestage_eval.episode import Body, Header
from simulate.arm import droid
from simulate.catalogue.objects import ObjectModel, catalogue
from simulate.looks.arm_skin import dress_link
from simulate.looks.room import Look, look_numbers
from simulate.looks.skins import paint_shapes
from simulate.looks.surface_textures import Color

CLOSE = 1e-6
"""m by which shapes of a trace and of the catalogue differ at most, being stored in single precision."""


def recorded_look(header: Header) -> Look | None:
    """The look that the cameras of a recording had; None for other people's recordings."""
    source = header.source
    bodies = {body.name for body in header.bodies}
    if source is None or source.recorder != "safestage" or not {"table", "floor"} <= bodies:
        return None
    return Look.drawn(*look_numbers(header.task or "", header.seed or 0))


def dress_arm(
    spec: mujoco.MjSpec, nodes: Mapping[str, Any], header: Header, robot_group: int
) -> set[str]:
    """Hang the arm's meshes on its links; the names of bodies whose own shapes are not to be drawn.

    Args:
        spec: the model to be drawn.
        nodes: body → its node in there.
        header: the trace's.
        robot_group: MuJoCo's visual group of arm and gripper.
    """
    out = {"table", "floor"}
    if any(note.startswith("arm model: tabletask") for note in header.notes):
        prefix = droid.PREFIX.replace("/", "_")
        links = [body.name for body in header.bodies if body.kind in ("robot", "gripper")]
        out |= {
            name
            for name in links
            if dress_link(spec, nodes[name], name.removeprefix(prefix), robot_group)
        }
    return out


def paint_body(
    spec: mujoco.MjSpec, node: Any, body: Body, color: Color | None, opacity: float
) -> None:
    """Paint the shapes of a body that is a thing of the catalogue; ``color``: its role's, all over."""
    found = None if body.kind in ("robot", "gripper", "region") else modelled(body)
    if found is not None:
        paint_shapes(spec, node.geoms, body.name, *found, color, opacity)


def modelled(body: Body) -> tuple[str, ObjectModel] | None:
    """Name and model in the catalogue of a body with just those shapes and that material."""
    named = catalogue().get(body.name)
    if named is not None and _fits(body, named):
        return body.name, named
    return next(((name, m) for name, m in catalogue().items() if _fits(body, m)), None)


def _fits(body: Body, model: ObjectModel) -> bool:
    parts = model.parts()
    return (
        body.material == model.material
        and len(parts) == len(body.geoms)
        and all(
            part.kind == geom.kind
            and np.allclose(part.size, geom.size, atol=CLOSE)
            and np.allclose(part.position, geom.position, atol=CLOSE)
            for part, geom in zip(parts, body.geoms, strict=True)
        )
    )
