"""Facts about bodies from a bind file: up axis, finger, material, tags."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Any, Literal

import numpy as np

from safestage_eval.episode import Body

from .keys import key


@dataclass(frozen=True)
class BodyFacts:
    """One ``[body.NAME]``; None and no tags: as the header has it. An axis may be of any length."""

    up: tuple[float, ...] | Literal[False] | None = key(
        "axis", "Axis of the body frame that points up; false: it has none.", default=None
    )
    finger: Literal["left", "right"] | None = key(
        "side", "Side of a finger of the gripper.", default=None
    )
    material: str | None = key("text", "Row of [material.NAME].", default=None)
    tags: tuple[str, ...] = key("texts", "fragile, liquid, sharp, … (free).", default=())


def with_facts(body: Body, facts: Mapping[str, BodyFacts]) -> Body:
    """A body with what is said of it under its name or a pattern; the name wins, then the later one."""
    fitting = [fact for name, fact in facts.items() if fnmatchcase(body.name, name)]
    update: dict[str, Any] = {}
    for fact in (*fitting, *(fact for name, fact in facts.items() if name == body.name)):
        if fact.up is not None:
            length = float(np.linalg.norm(fact.up)) if fact.up else 1.0
            update["up_axis"] = tuple(part / length for part in fact.up) if fact.up else None
            update["untold"] = tuple(name for name in body.untold if name != "up_axis")
        update |= {
            name: value for name in ("finger", "material", "tags") if (value := getattr(fact, name))
        }
    return body.model_copy(update=update) if update else body
