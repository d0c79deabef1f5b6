"""Segment that a finding measures between two bodies, and the limit around one of them, to draw."""

from __future__ import annotations

import re
from typing import Any

from safestage_eval.episode import Header
from safestage_eval.verdicts import Verdict

_CALL = re.compile(r"(?:(?:start|end) of )?(\w+)\((.*?)\)(?: since (.+))?")

FLAT = {"clearance": False, "clearance_xy": True}
"""Distance between two bodies → whether it is one of their projections onto the floor."""

MOVED = ("displacement", "lift")
"""Distances of a body from where it was."""

GUARDED = ("protected", "fragile", "dependent")
"""Roles around which a limit is drawn, in this order."""


def witness(verdict: Verdict, header: Header, success: float | None) -> dict[str, Any] | None:
    """Witness of a verdict in 3-D; None where there is nothing to draw.

    - ``{"kind": "gap", "a": names, "b": names, "flat": …, "limit": m or null}``: the shortest segment from a
      to b, and the limit as a shell around b.
    - ``{"kind": "path", "body", "since": s}``: from where a body was to where it is.
    - ``{"kind": "touch", "name", "a": names, "b": names, "flat": false}``: where two bodies touch or are nearest, with
      what another signal measures between them.
    - ``{"kind": "value", "name", "body"}``: what is measured of a body, beside it.
    """
    match = _CALL.fullmatch(verdict.signal or "")
    if match is None:
        return None
    name, inside, since = match.groups()
    whole = any(body.name == inside for body in header.bodies)
    if name in MOVED and whole and since in (None, "success"):
        begin = 0.0 if since is None else success
        return None if begin is None else {"kind": "path", "body": inside, "since": begin}
    if whole:
        return {"kind": "value", "name": name, "body": inside}
    sides = _sides(inside, header)
    if sides is None:
        return None
    a, b = sides
    if _guarded(a, header) < _guarded(b, header):
        a, b = b, a
    if name not in FLAT:
        return {"kind": "touch", "name": name, "a": a, "b": b, "flat": False}
    limit = verdict.limit if verdict.limit is not None and verdict.limit > 0 else None
    return {"kind": "gap", "a": a, "b": b, "flat": FLAT[name], "limit": limit}


def _sides(inside: str, header: Header) -> tuple[list[str], list[str]] | None:
    """The bodies on either side of the comma; names may have commas themselves."""
    pieces = inside.split(", ")
    for cut in range(1, len(pieces)):
        sides = [_bodies(", ".join(part), header) for part in (pieces[:cut], pieces[cut:])]
        if all(sides):
            return sides[0], sides[1]
    return None


def _bodies(name: str, header: Header) -> list[str]:
    if any(body.name == name for body in header.bodies):
        return [name]
    kinds = {"robot": ("robot", "gripper"), "gripper": ("gripper",)}.get(name, ())
    return [body.name for body in header.bodies if body.kind in kinds]


def _guarded(names: list[str], header: Header) -> int:
    for rank, role in enumerate(GUARDED):
        if set(names) & set(header.roles.get(role, ())):
            return rank
    return len(GUARDED)
