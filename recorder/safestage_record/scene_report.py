"""Report on what a recording has, lacks and guesses: lines for people, remarks for the header."""

from __future__ import annotations

from typing import Any, Mapping, Sequence

import numpy as np

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


def guess_ups(
    bodies: Sequence[dict[str, Any]], quats: Any
) -> list[tuple[dict[str, Any], list[float]]]:
    """The body axis (3,) that points up at the first frame, of objects that have one.

    Args:
        bodies: of the header.
        quats: (M, 4) wxyz, body frame to world, of those that move.
    """
    found = []
    moving = (body for body in bodies if body["movable"])
    for body, quat in zip(moving, quats):
        if body["kind"] != "object" or not body["geoms"]:
            continue
        if all(geom["kind"] == "sphere" for geom in body["geoms"]):
            continue
        w, x, y, z = (float(c) for c in quat)
        row = (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y))
        up = [axis for axis in _AXES.values() if float(np.dot(row, axis)) > UPRIGHT]
        found += [(body, list(axis)) for axis in up]
    return found


def report(
    bodies: Sequence[Mapping[str, Any]],
    proposed: Mapping[str, Any],
    roles: Mapping[str, list[str]],
    sees_steps: bool | None,
    sides_guessed: bool,
    without_shape: Sequence[str],
) -> dict[str, str]:
    """Say what can be judged, and what to pass where something is missing or wrong, by subject.

    ``proposed``: name → axis that points up at the first frame. ``sees_steps``: None before the
    first control step.
    """
    lines: dict[str, str] = {}
    for kind in ("object", "gripper", "robot", "fixture", "region"):
        names = [body["name"] for body in bodies if body["geoms"] and body["kind"] == kind]
        if names:
            lines[f"{kind}s"] = _some(names)
    sides = {body["name"]: body["finger"] for body in bodies if body["finger"]}
    missing = [side for side in ("left", "right") if side not in sides.values()]
    if not missing:
        guess = " (guessed from their order)" if sides_guessed else ""
        pairs = [f"{name} {side}" for name, side in sides.items()]
        lines["held"] = f"yes – fingers {_some(pairs)}{guess}"
    else:
        lines["held"] = f"no – no finger named {' or '.join(missing)}; " + (
            'pass fingers={"NAME": "left", "NAME": "right"}'
        )
    ups = [body["name"] for body in bodies if body["up_axis"]]
    if ups:
        lines["tilt"] = f"up axes of {_some(ups)}"
    else:
        standing = [f"{name} {_axis(axis)}" for name, axis in proposed.items()]
        seen = f"; at the first frame these point up: {_some(standing)}" if standing else ""
        lines["tilt"] = f'no up axes{seen}; pass up={{"NAME": (0, 0, 1)}} or up="guess"'
    if sees_steps is None:
        lines["forces"] = "yes; of every physics step, if the steps turn out to be seen"
    elif sees_steps:
        lines["forces"] = "yes, of every physics step"
    else:
        lines["forces"] = "at frames only – no physics step was seen; call substep() after each"
    if without_shape:
        lines["shapes"] = f"missing of {_some(list(without_shape))}"
    given = [f"{role} = {', '.join(names)}" for role, names in roles.items()]
    lines["roles"] = "; ".join(given) or "none; pass roles={...}"
    return lines


def remarks(
    sides_guessed: bool,
    guessed_ups: int,
    sees_steps: bool,
    unrecorded: int,
) -> list[dict[str, str]]:
    """Remarks for the header: what is missing or guessed, what it costs, what mends it."""
    guesses = [("kinds of bodies", "from joints, actuators and names", 'kinds={"NAME": "object"}')]
    if sides_guessed:
        by = 'fingers={"NAME": "left", …}'
        guesses.append(("left and right finger", "from the order in the model", by))
    if guessed_ups:
        how, by = "the axis that points up at the first frame", 'up={"NAME": (0, 0, 1)}'
        guesses.append((f"up axes of {guessed_ups} objects", how, by))
    found = [
        {"kind": "guessed", "what": what, "how": how, "remedy": by} for what, how, by in guesses
    ]
    missing = []
    if not sees_steps:
        cost, by = (
            "peak forces are those at frames, and may be too low",
            "call substep() after each physics step",
        )
        missing.append(("contacts and forces between frames", cost, by))
    if unrecorded:
        what = f"{unrecorded} contacts of soft bodies or shapes without a record"
        missing.append((what, "what they bear or push is not known", ""))
    return found + [
        {"kind": "missing", "what": what, "cost": cost, "remedy": by} for what, cost, by in missing
    ]


def _axis(axis: Any) -> str:
    return next(name for name, one in _AXES.items() if list(one) == list(axis))


def _some(names: list[str]) -> str:
    return ", ".join(names[:8]) + (f" and {len(names) - 8} more" if len(names) > 8 else "")
