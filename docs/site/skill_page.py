"""The page of skills, read from their signatures and docstrings."""

from __future__ import annotations

import inspect
import re

from simulate.skills import SKILLS

HEAD = """\
# Skills

What the references of [task files](../tasks.md#a-task-file) are written in. Lengths in m, angles in degrees, times in s; TCP
is the tool centre point. References see the true state of the world; policies never do.
"""

ARGUMENT = re.compile(r"^ {4}(\w+): (.+(?:\n {8}.+)*)", re.MULTILINE)


def skills_page() -> str:
    """A section for each skill: what it does, its arguments and their defaults."""
    parts = [HEAD]
    for name, skill in SKILLS.items():
        text = inspect.getdoc(skill) or ""
        said = {word: " ".join(about.split()) for word, about in ARGUMENT.findall(text)}
        parts.append(f"## `{name}`\n\n{text.partition(chr(10))[0]}\n")
        taken = list(inspect.signature(skill).parameters.values())[1:]
        rows = [
            f"| `{one.name}` | {_default(one)} | {said.get(one.name, '').replace('``', '`')} |"
            for one in taken
        ]
        if rows:
            parts.append("\n".join(["| argument | default | |", "|---|---|---|", *rows, ""]))
    return "\n".join(parts)


def _default(parameter: inspect.Parameter) -> str:
    value = parameter.default
    return "" if value is inspect.Parameter.empty else f"`{value!r}`"
