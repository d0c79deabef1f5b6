"""Policies by name, by address or by import path."""

from __future__ import annotations

import importlib
import math
import sys
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

from safestage_eval.errors import InputError
from simulate.clients.address import address_of, is_address
from simulate.policy import Policy

from .controls import Idle, RandomNearHome
from .demonstration_policy import Demonstration
from .reference_policies import KINDS, Noisy, Reference
from .replay_policy import Replay

POLICIES = (
    "reference:safe",
    "reference:unsafe",
    "reference:GRADE=VALUE",
    "noisy:SIGMA[:safe|:unsafe]",
    "demonstration:safe|unsafe",
    "learned:NAME|FILE.onnx",
    "idle",
    "random-near-home",
    "replay:PATH[#EPISODE]",
    "PROTOCOL:URL[?OPTION=VALUE&…]",
    "MODULE:CLASS",
)
"""Forms of policy names that ``policy_named`` accepts. SIGMA is in rad, EPISODE an id where PATH holds several;
PROTOCOL is one of ``clients.address.PROTOCOLS``, as in ``openpi:ws://127.0.0.1:8000?name=pi05``."""

BUILT_IN = ("reference", "noisy", "demonstration", "learned", "replay")
"""Prefixes, before a colon, in names of this package's own policies; anything else is an import path."""


def policy_named(name: str, draw: Sequence[int] = (0,)) -> Policy:
    """A policy by name, or by import path.

    Args:
        name: one of ``POLICIES``.
        draw: seeds what is random in it; the same numbers give the same rollout.

    Raises InputError for what is none.
    """
    if is_address(name):
        address = address_of(name)
        from simulate.clients.remote import Remote

        return Remote(address, seed=draw[1] if len(draw) > 1 else None)
    kind, _, rest = name.partition(":")
    if kind == "reference" and _is_reference(rest):
        return Reference(rest)
    if kind == "noisy":
        sigma, _, reference = rest.partition(":")
        if _is_number(sigma) and float(sigma) >= 0 and _is_reference(reference or "safe"):
            return Noisy(reference or "safe", float(sigma), draw)
    if kind == "demonstration" and _is_reference(rest):
        return Demonstration(rest, draw)
    if kind == "learned" and rest:
        from .learned_policy import Learned

        return Learned(rest, draw)
    if kind == "replay" and rest:
        path, _, episode = rest.partition("#")
        return Replay(Path(path), episode or None)
    if kind not in BUILT_IN and rest.isidentifier():
        return imported(name)
    if name == "idle":
        return Idle()
    if name == "random-near-home":
        return RandomNearHome(draw)
    raise InputError(f"policy {name!r}", "no such policy.", ", ".join(POLICIES))


@cache
def policy_name(name: str) -> str:
    """A policy's name in episodes; a user's policy is not instantiated for it."""
    if is_address(name):
        return address_of(name).name
    kind, _, rest = name.partition(":")
    if kind not in BUILT_IN and rest.isidentifier():
        return str(class_at(name).name)
    return policy_named(name).name


def class_at(path: str) -> Any:
    """The class at ``my_module:MyPolicy``, from the present folder or what is installed.

    Raises InputError where there is none, or it is no policy.
    """
    where = f"policy {path!r}"
    module_name, _, name = path.partition(":")
    here = str(Path.cwd())
    if here not in sys.path:
        sys.path.append(here)
    try:
        module = importlib.import_module(module_name)
    except ModuleNotFoundError as error:
        fix = "run from the module's folder, or install it"
        raise InputError(where, f"{error}.", ", ".join(POLICIES), fix) from None
    result = getattr(module, name, None)
    if not isinstance(result, type):
        classes = [n for n, value in vars(module).items() if isinstance(value, type)]
        raise InputError(where, f"{module_name} has no class {name!r}.", ", ".join(classes))
    lacking = [part for part in ("reset", "act") if not callable(getattr(result, part, None))]
    if not isinstance(getattr(result, "name", None), str):
        lacking.append("name (a text, in the class)")
    if lacking:
        raise InputError(where, f"it has no {', no '.join(lacking)}.", fix="see docs/tasks.md")
    return result


@cache
def imported(path: str) -> Policy:
    """The policy at an import path: made once per process, without arguments, and reset after."""
    policy: Policy = class_at(path)()
    return policy


def _is_reference(kind: str) -> bool:
    grade, _, value = kind.partition("=")
    return kind in KINDS or (bool(grade) and _is_number(value))


def _is_number(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False
