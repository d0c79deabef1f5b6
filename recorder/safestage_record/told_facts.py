"""Facts about bodies from the user, by their places in the scene, and from their names."""

from __future__ import annotations

import difflib
import re
from typing import Any, Mapping, Sequence, Union

import numpy as np

from .record_error import RecordError

KINDS = ("robot", "gripper", "object", "fixture", "region")
SIDES = ("left", "right")

SETTINGS = ("roles", "kinds", "fingers", "up", "tags")
Names = Union[str, Sequence[str]]

_GRIPPER = re.compile(r"gripper|finger|thumb|hand(?!le)|claw|knuckle|robotiq", re.IGNORECASE)
_ARM_SIDE = re.compile(r"^gripper\d+_(right_|left_)?|^robot\d+[:_]", re.IGNORECASE)
"""robosuite's names say the side of the arm first, which is no finger's."""


class ToldFacts:
    """Roles, kinds, fingers, up axes and tags as given, checked against the names of the bodies.

    Attributes:
        roles: role → names.
        kinds: body number → kind; it holds for what hangs on the body, too.
        fingers: body number → left or right.
        ups: body number → unit vector (3,) of the body frame.
        tags: body number → words.
        guess_up: True where up axes are taken from the first frame.
    """

    def __init__(
        self,
        names: list[str],
        roles: Mapping[str, Names] | None = None,
        kinds: Mapping[str, str] | None = None,
        fingers: Mapping[str, str] | None = None,
        up: str | Mapping[str, Sequence[float]] | None = None,
        tags: Mapping[str, Sequence[str]] | None = None,
    ) -> None:
        """Check what was given. Raises RecordError for a body, kind or side that does not exist."""
        self.roles: dict[str, list[str]] = {}
        for role, given in (roles or {}).items():
            some = [given] if isinstance(given, str) else list(given)
            self.roles[role] = [
                names[find_bodies(n, names, f"role {role!r}: the body")] for n in some
            ]
        self.kinds = _by_number(kinds or {}, names, KINDS, "kind")
        self.fingers = _by_number(fingers or {}, names, SIDES, "side")
        if isinstance(up, str) and up != "guess":
            raise RecordError(f'up is {up!r}. Allowed: "guess", or {{"NAME": (0, 0, 1)}}.')
        self.guess_up = up == "guess"
        axes = {} if up is None or isinstance(up, str) else up
        self.ups = {
            find_bodies(name, names, "the body of the up axis,"): _unit(axis, name)
            for name, axis in axes.items()
        }
        self.tags = {
            find_bodies(name, names, "the tagged body"): list(words)
            for name, words in (tags or {}).items()
        }


def names_gripper(name: str) -> bool:
    """Whether a body's name says that it is part of a gripper."""
    return bool(_GRIPPER.search(_ARM_SIDE.sub("", name)) or _GRIPPER.search(name))


def named_side(*names: str) -> str | None:
    """Left or right, where one of the names of a finger (its body's, its joint's) says so."""
    for full in names:
        name = _ARM_SIDE.sub("", full).lower()
        for side in SIDES:
            if side in name or re.search(rf"(^|[^a-z]){side[0]}([^a-z]|$)", name):
                return side
    return None


def find_bodies(wanted: str, names: list[str], what: str) -> int:
    """The place of a body by name. Raises RecordError where there is none, with those that are alike."""
    name = wanted.replace("/", "_")
    if name in names:
        return names.index(name)
    near = difflib.get_close_matches(name, names, 4, 0.4) or names[:12]
    raise RecordError(
        f"{what} {wanted!r} is no body of the model. Near it: {', '.join(near)}. "
        f"All {len(names)}: print(recorder.body_names)."
    )


def tell_apart(names: Sequence[str]) -> list[str]:
    """Names as a trace has them: without slashes, none empty, none twice."""
    found: list[str] = []
    for i, given in enumerate(names):
        name = given.replace("/", "_") or f"body_{i}"
        found.append(f"{name}_{i}" if name in found else name)
    return found


def _by_number(
    given: Mapping[str, str], names: list[str], allowed: tuple[str, ...], what: str
) -> dict[int, str]:
    found = {}
    for name, value in given.items():
        if value not in allowed:
            raise RecordError(f"{what} {value!r} of body {name!r}. Allowed: {', '.join(allowed)}.")
        found[find_bodies(name, names, f"the body of {what} {value!r},")] = value
    return found


def _unit(axis: Sequence[float], name: str) -> list[float]:
    values: Any = np.array(axis, float)
    if values.shape != (3,) or not np.linalg.norm(values) > 0:
        raise RecordError(
            f"the up axis of {name!r} is {axis!r}. Allowed: three numbers, not all 0."
        )
    return [float(v) for v in values / np.linalg.norm(values)]
