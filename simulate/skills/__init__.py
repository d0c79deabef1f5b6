"""A small vocabulary of closed-loop arm skills, from which reference behaviours are written.

Each skill is a generator of eight-dimensional actions at 15 Hz that looks at the world's true
state between them. All lengths in metres, angles in degrees, times in seconds; the TCP's approach
direction is its local z, its closing direction local x.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from safestage_eval.errors import InputError

from .arm_motion import Actions, Motion
from .home import home
from .pick import pick
from .place import place
from .push import push
from .release import release
from .tilt import tilt
from .via import via
from .wait import wait

SKILLS: dict[str, Callable[..., Actions]] = {
    skill.__name__: skill for skill in (pick, place, via, release, push, tilt, wait, home)
}
"""The skills that task files may use; each takes a Motion, then the arguments of the task file."""


def run_skill(motion: Motion, skill: str, arguments: dict[str, Any]) -> Actions:
    """One step of a reference. Raises InputError for an unknown skill or argument."""
    if skill not in SKILLS:
        raise InputError("reference", f"no skill {skill!r}.", ", ".join(SKILLS))
    try:
        return SKILLS[skill](motion, **arguments)
    except TypeError as error:
        raise InputError(f"reference, skill {skill!r}", str(error)) from None
