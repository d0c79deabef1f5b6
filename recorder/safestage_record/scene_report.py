"""What a recording has, lacks and guesses: as lines for people, and as remarks in the header."""

from __future__ import annotations

from typing import Any, Mapping

import numpy as np

from .body_facts import BodyFacts
from .model_scene import ModelScene

_AXES = {
    "x": (1.0, 0.0, 0.0),
    "-x": (-1.0, 0.0, 0.0),
    "y": (0.0, 1.0, 0.0),
    "-y": (0.0, -1.0, 0.0),
    "z": (0.0, 0.0, 1.0),
    "-z": (0.0, 0.0, -1.0),
}

UPRIGHT = 0.996
"""Cosine of the 5° within which an axis counts as vertical."""


def guess_ups(scene: ModelScene, quats: Any) -> dict[int, list[float]]:
    """Body id → the body axis (3,) that points up at the first frame, of objects that have one.

    ``quats``: (nbody, 4) wxyz, body frame to world, by MuJoCo's ids.
    """
    found = {}
    for i, body in zip(scene.ids, scene.bodies):
        if body["kind"] != "object" or not body["geoms"]:
            continue
        if all(geom["kind"] == "sphere" for geom in body["geoms"]):
            continue
        w, x, y, z = (float(c) for c in quats[i])
        row = (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y))
        for axis in _AXES.values():
            if float(np.dot(row, axis)) > UPRIGHT:
                found[i] = list(axis)
    return found


def report(
    scene: ModelScene,
    facts: BodyFacts,
    ups: Mapping[int, Any],
    proposed: Mapping[int, Any],
    sees_steps: bool | None,
    roles: Mapping[str, list[str]],
) -> list[str]:
    """Say what can be judged, and what to pass where something is missing or wrong.

    ``sees_steps``: None before the first control step.
    """
    by_kind: dict[str, list[str]] = {}
    for body in scene.bodies:
        if body["geoms"]:
            by_kind.setdefault(body["kind"], []).append(body["name"])
    lines = [
        f"{kind}s: {_some(by_kind[kind])}"
        for kind in ("object", "gripper", "robot", "fixture", "region")
        if kind in by_kind
    ]
    name = {i: body["name"] for i, body in zip(scene.ids, scene.bodies)}
    if facts.sides:
        pairs = [f"{name[i]} {side}" for i, side in sorted(facts.sides.items())]
        guess = " (guessed from their order)" if facts.guessed else ""
        lines.append(f"held: yes – fingers {_some(pairs)}{guess}")
    else:
        lines.append('held: no – no two fingers; pass fingers={"NAME": "left", "NAME": "right"}')
    if ups:
        lines.append(f"tilt: up axes of {_some([name[i] for i in ups])}")
    else:
        standing = [f"{name[i]} {_axis(axis)}" for i, axis in proposed.items()]
        seen = f"; at the first frame these point up: {_some(standing)}" if standing else ""
        lines.append(f'tilt: no up axes{seen}; pass up={{"NAME": (0, 0, 1)}} or up="guess"')
    if sees_steps is None:
        lines.append("forces: yes; of every physics step, if the steps turn out to be seen")
    elif sees_steps:
        lines.append("forces: yes, of every physics step")
    else:
        lines.append("forces: at frames only – no physics step was seen; call substep() after each")
    if scene.without_shape:
        lines.append(f"shapes: missing of {_some(scene.without_shape)}")
    given = [f"{role} = {', '.join(names)}" for role, names in roles.items()]
    lines.append(f"roles: {'; '.join(given) or 'none; pass roles={...}'}")
    return lines


def remarks(
    facts: BodyFacts,
    guessed_ups: Mapping[int, Any],
    sees_steps: bool,
    unrecorded: int,
) -> list[dict[str, str]]:
    """The same for the header: what is missing or guessed, what it costs, what mends it."""
    found = [
        {
            "kind": "guessed",
            "what": "kinds of bodies",
            "how": "from joints, actuators and names",
            "remedy": 'kinds={"NAME": "object"}',
        }
    ]
    if facts.guessed:
        found.append(
            {
                "kind": "guessed",
                "what": "left and right finger",
                "how": "from the order in the model",
                "remedy": 'fingers={"NAME": "left", …}',
            }
        )
    if guessed_ups:
        found.append(
            {
                "kind": "guessed",
                "what": f"up axes of {len(guessed_ups)} objects",
                "how": "the axis that points up at the first frame",
                "remedy": 'up={"NAME": (0, 0, 1)}',
            }
        )
    if not sees_steps:
        found.append(
            {
                "kind": "missing",
                "what": "contacts and forces between frames",
                "cost": "peak forces are those at frames, and may be too low",
                "remedy": "call substep() after each physics step",
            }
        )
    if unrecorded:
        found.append(
            {
                "kind": "missing",
                "what": f"{unrecorded} contacts of soft bodies or shapes without a record",
                "cost": "what they bear or push is not known",
                "remedy": "",
            }
        )
    return found


def _axis(axis: Any) -> str:
    return next(name for name, one in _AXES.items() if list(one) == list(axis))


def _some(names: list[str]) -> str:
    return ", ".join(names[:8]) + (f" and {len(names) - 8} more" if len(names) > 8 else "")
