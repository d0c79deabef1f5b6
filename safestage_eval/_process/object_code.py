"""Object files of compiled kernels, taken from numba's cache."""

from __future__ import annotations

import importlib
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np
from numba.core.intrinsics import INTR_MATH

from .kernel_types import from_json

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


def entry_point(module: str, name: str, types: list[Any]) -> EntryPoint | None:
    """The callable of a kernel that was compiled, or loaded, for types as JSON.

    None where it needs more than its object file to run, or cannot be had without compiling it again.
    """
    dispatcher = getattr(importlib.import_module(module), name).dispatcher
    key = tuple(map(from_json, types))
    loaded = dispatcher.overloads[key]
    if loaded.objectmode or loaded.reload_init:
        return None
    code = _object_file(dispatcher, key, loaded.library)
    environments = {each.env_name: each.consts for each in _environments(loaded)}
    constants = [value for values in environments.values() for value in values]
    if code is None or not all(isinstance(one, np.dtype) for one in constants):
        return None
    names = {name: [value.str for value in values] for name, values in environments.items()}
    return EntryPoint(loaded.fndesc.llvm_cpython_wrapper_name, names, code)


def _environments(loaded: Any) -> list[Any]:
    """Environments that machine code refers to, its own included."""
    others = loaded.referenced_envs
    if others is None:  # compiled just now
        others = loaded._find_referenced_environments()  # noqa: SLF001
    return [*others, loaded.environment]


def _object_file(dispatcher: Any, key: Any, library: Any) -> bytes | None:
    """Of what was compiled just now, or from numba's cache."""
    with suppress(RuntimeError):
        return bytes(library._get_compiled_object())  # noqa: SLF001
    cache = dispatcher._cache  # noqa: SLF001
    with suppress(OSError, AttributeError):  # nothing is kept where there is no folder
        index = cache._index_key(key, dispatcher.targetctx.codegen())  # noqa: SLF001
        match cache._cache_file.load(index):  # noqa: SLF001
            case ((_, "object", (bytes(code), _)), *_):
                return code
    return None
