"""Object files of compiled kernels, taken from numba's cache."""

from __future__ import annotations

from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np
from numba.core.intrinsics import INTR_MATH

LIBRARY_FUNCTIONS = tuple(INTR_MATH)
"""Functions of the C library that object files may call by their names."""


class EntryPoint(NamedTuple):
    """Function of an object file that Python calls.

    Attributes:
        symbol: its name in the object file.
        environments: variables that stand for what functions look up in Python, which are
            names of dtypes: variable → dtypes.
        code: the object file.
    """

    symbol: str
    environments: dict[str, list[str]]
    code: bytes


def entry_point(dispatcher: Any, types: tuple[Any, ...]) -> EntryPoint | None:
    """The callable for types that ``dispatcher`` has loaded.

    None where it is not on disk, or where it needs more than its object file to run.
    """
    loaded = dispatcher.overloads.get(types)
    if loaded is None or loaded.referenced_envs is None or loaded.objectmode:
        return None
    code = _kept(dispatcher, types)
    environments = {each.env_name: each.consts for each in loaded.referenced_envs}
    environments[loaded.environment.env_name] = loaded.environment.consts
    constants = [value for values in environments.values() for value in values]
    if (
        code is None
        or loaded.reload_init
        or not all(isinstance(one, np.dtype) for one in constants)
    ):
        return None
    names = {name: [value.str for value in values] for name, values in environments.items()}
    return EntryPoint(loaded.fndesc.llvm_cpython_wrapper_name, names, code)


def _kept(dispatcher: Any, types: tuple[Any, ...]) -> bytes | None:
    """The object file that numba's cache has."""
    cache = dispatcher._cache  # noqa: SLF001
    with suppress(OSError, AttributeError):  # nothing is kept where there is no folder
        key = cache._index_key(types, dispatcher.targetctx.codegen())  # noqa: SLF001
        match cache._cache_file.load(key):  # noqa: SLF001
            case ((_, "object", (bytes(code), _)), *_):
                return code
    return None
