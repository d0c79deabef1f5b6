"""Skins on the bodies of a trace, where it is SafeStage's own recording of catalogue objects."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np

from safestage_eval.episode import Body, Header
from simulate.arm import droid
from simulate.catalogue.objects import ObjectModel, catalogue
from simulate.looks.arm_skin import dress_link
from simulate.looks.room import Look, dress, look_numbers
from simulate.looks.skins import skin
from simulate.looks.texture_noise import Color

CLOSE = 1e-6
"""m by which shapes of a trace and of the catalogue differ at most, being stored in single precision."""


def recorded_look(header: Header) -> Look | None:
    """The look that the cameras of a recording had; None for other people's recordings."""
    source = header.source
    bodies = {body.name for body in header.bodies}
    if source is None or source.recorder != "safestage" or not {"table", "floor"} <= bodies:
        return None
    return Look.drawn(*look_numbers(header.task or "", header.seed or 0))


def dress_bodies(
    spec: mujoco.MjSpec,
    nodes: Mapping[str, Any],
    header: Header,
    colors: Mapping[str, Color],
    opacity: Mapping[str, float],
    robot_group: int,
) -> set[str]:
    """Hang skins on a trace's bodies; the names of those whose own shapes are not to be drawn.

    Args:
        spec: the model to be drawn.
        nodes: body → its node in there.
        header: the trace's.
        colors: body → a colour all over: its role's.
        opacity: body → 0 (unseen) … 1.
        robot_group: MuJoCo's visual group of arm and gripper.
    """
    own_arm = any(note.startswith("arm model: tabletask") for note in header.notes)
    out = {"table", "floor"}
    for body in header.bodies:
        node = nodes[body.name]
        if body.kind in ("robot", "gripper"):
            link = body.name.removeprefix(droid.PREFIX.replace("/", "_"))
            if own_arm and dress_link(spec, node, link, robot_group):
                out.add(body.name)
            continue
        found = modelled(body)
        if found is not None and not found[1].region:
            parts = skin(*found, colors.get(body.name))
            dress(spec, node, body.name, parts, opacity=opacity.get(body.name, 1.0), group=0)
            out.add(body.name)
    return out


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
