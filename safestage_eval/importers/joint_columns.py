"""Which column of a table holds joint positions, by the names of its numbers or by its own."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from .importer import SourceError
from .robot_model import RobotModel, match_joints

WORDS = (
    r"(?:^|[./_])joint_?pos(?:ition)?s?$",
    r"(?:^|[./_])(?:q|qpos|joints?|joint_?states?|(?<![a-z]_)positions?)$",
    r"(?:^|[./])(?:observation\.)?(?:state|robot_state)$",
)
"""Patterns of column names that may be joint positions, the plainest first."""

OTHERS = r"action|target|command|cmd|vel|effort|torque|goal|desired|leader|gripper"
"""Pattern of what is none, whatever else its name says."""

NUMBERED = re.compile(r"(.*?)[\[_.]?(\d+)\]?")
"""``q1``, ``joint_pos_1``, ``position[1]``: a name, and the number of one of several columns."""


def may_be_joints(name: str) -> bool:
    """Whether a column of this name may hold joint positions."""
    name = name.lower()
    return not re.search(OTHERS, name) and any(re.search(word, name) for word in WORDS)


def grouped(names: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Columns of one number each that belong together: their common name → they in their order."""
    groups: dict[str, list[tuple[int, str]]] = {}
    for name in names:
        match = NUMBERED.fullmatch(name)
        if match is not None and match[1]:
            groups.setdefault(match[1], []).append((int(match[2]), name))
    return {
        stem: tuple(name for _, name in sorted(some))
        for stem, some in groups.items()
        if stem not in names
    }


def plain(name: str) -> str:
    """The name of a joint as its column spells it: ``elbow_flex.pos`` is ``elbow_flex``."""
    return re.sub(r"[._/](pos|position|q)$|^(q|pos|position|joint_position)[._/]", "", name)


def joint_column(model: RobotModel, columns: Mapping[str, Sequence[str]], where: str) -> str:
    """The column of joint positions, or the part of it: ``"observation.state[0:6]"``.

    Args:
        model: the robot.
        columns: name → a name for each number in a row of it, empty where it has none.
        where: for messages.

    Raises:
        SourceError: none has names of the robot's joints, or is called so and as wide as they are many.
    """
    known = {joint.name for joint in model.joints}
    columns = {c: names for c, names in columns.items() if not re.search(OTHERS, c.lower())}
    best = ("", 0, 0)
    for column, names in columns.items():
        start = 0
        for i, name in enumerate((*names, "")):
            if plain(name) in known:
                continue
            if i - start > best[2] - best[1]:
                best = column, start, i
            start = i + 1
    if best[0]:
        return f"{best[0]}[{best[1]}:{best[2]}]"
    for word in WORDS:
        for column, names in columns.items():
            if re.search(word, column.lower()) and match_joints(model, (), len(names)) is not None:
                return column
    seen = ", ".join(f"{column} ({len(names)})" for column, names in columns.items())
    raise SourceError(
        where,
        f"no column is known to hold positions of the {len(model.driven)} joints "
        f"({', '.join(joint.name for joint in model.driven)}).",
        f"columns and how many numbers they have: {seen or 'none'}",
        '[columns] joint_position = "COLUMN[0:7]", and [robot] joints = ["…", …] for their order, '
        "in the map file (docs/import/joints.md)",
    )
