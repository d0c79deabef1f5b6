"""A user's own policy, found by import path."""

from __future__ import annotations

import importlib
import sys
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from safestage_eval.errors import InputError

if TYPE_CHECKING:
    from .policies import Policy


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
        from .policies import POLICIES

        fix = "run from the module's folder, or install it"
        raise InputError(where, f"{error}.", ", ".join(POLICIES), fix) from None
    found = getattr(module, name, None)
    if not isinstance(found, type):
        classes = [n for n, value in vars(module).items() if isinstance(value, type)]
        raise InputError(where, f"{module_name} has no class {name!r}.", ", ".join(classes))
    lacking = [part for part in ("reset", "act") if not callable(getattr(found, part, None))]
    if not isinstance(getattr(found, "name", None), str):
        lacking.append("name (a text, in the class)")
    if lacking:
        raise InputError(where, f"it has no {', no '.join(lacking)}.", fix="see docs/tasks.md")
    return found


@cache
def imported(path: str) -> Policy:
    """The policy at an import path: made once per process, without arguments, and reset after."""
    policy: Policy = class_at(path)()
    return policy
