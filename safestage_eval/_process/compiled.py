"""How numerical kernels are compiled, and where the machine code is kept.

Numba's own cache looks only at the file of the function it compiles: a kernel that calls an edited
helper in another file would keep the old helper. So the cache folder is named after the content of
all files of the kernel's room (its folder), and stale machine code can never answer. Kernels
therefore call no kernels of another room.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
from numba.core import caching
from numba.core.runtime.nrt import rtsys

F = TypeVar("F", bound=Callable[..., Any])

KERNELS: list[Any] = []
"""Every kernel that was imported, as numba's dispatcher."""


@cache
def cache_name(room: Path) -> str:
    """Name of the folder of a room's machine code, after the content of its sources."""
    digest = hashlib.sha256(Path(__file__).read_bytes())
    for source in sorted(room.glob("*.py")):
        digest.update(source.read_bytes())
    return f"kernels-{digest.hexdigest()[:12]}"


@cache
def cache_folder(room: Path) -> Path | None:
    """Beside the room's sources where that is writable, else under the user's cache folder.

    Where neither is, beside the sources if there is machine code already; None if there is none.
    """
    name = cache_name(room)
    beside = room / "__pycache__" / name
    if os.access(room, os.W_OK):
        return beside
    try:
        own = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    except RuntimeError:  # a user without a home
        own = Path(os.devnull)
    if is_writable(own):
        return own / "safestage" / name
    return beside if beside.is_dir() else None


def is_writable(folder: Path) -> bool:
    """Whether a folder can be written to, or made; what may not even be looked at cannot."""
    ways = (folder, *folder.parents)
    there = next((each for each in ways if os.access(each, os.F_OK)), None)
    return there is not None and there.is_dir() and os.access(there, os.W_OK | os.X_OK)


_ByConfig: type[Any] = vars(caching).get("UserProvidedCacheLocator") or vars(caching)["_UserProvidedCacheLocator"]  # fmt: skip


class _Locator(_ByConfig):  # type: ignore[misc]
    """Where ``numba.config.CACHE_DIR`` says; a folder that is there need not be writable to be read."""

    def ensure_cache_path(self) -> None:
        """Make the folder. Raises OSError."""
        if not Path(self.get_cache_path()).is_dir():
            super().ensure_cache_path()


class _Files(caching.CompileResultCacheImpl):  # type: ignore[misc]
    _locator_classes = (_Locator,)


class _Cache(caching.FunctionCache):  # type: ignore[misc]
    """Numba's cache, which loads machine code without getting ready to compile.

    Before it loads a kernel, numba imports all that it could compile, SciPy's linear algebra with it: a
    third of what a process does up to its first verdict. Compiling still begins with that.
    """

    _impl_class = _Files

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep a compiled kernel, unless the disk is full or may not be written to."""
        with suppress(OSError):
            super().save_overload(sig, data)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The compiled kernel from disk; None where there is none."""
        rtsys.initialize(target_context)
        with suppress(OSError):
            return self._load_overload(sig, target_context)
        return None


def kernel(function: F) -> F:
    """Compile on first call, with IEEE arithmetic (no fast-math), without the GIL, and keep it.

    References to arrays are not counted: whoever calls it holds them until it returns. Counting
    them, at every row of an array that is looked at, took four fifths of a distance. So it cannot
    allocate (that is an error when it is compiled); what must is ``allocating``.
    """
    return _compiled(function, inline=False)


def helper(function: F) -> F:
    """As kernel, for a small function: its code goes into its callers.

    A call hands over every array of a named tuple, which takes longer than such a function. One whose
    name begins with an underscore can be called by kernels only.
    """
    return _compiled(function, inline=True)


def allocating(function: F) -> F:
    """As kernel, for a function that makes arrays of its own."""
    return _compiled(function, inline=False, counted=True)


def _compiled(function: F, *, inline: bool, counted: bool = False) -> F:
    chosen = numba.config.CACHE_DIR
    folder = chosen or cache_folder(Path(function.__code__.co_filename).parent)
    try:
        dispatcher = numba.njit(
            nogil=True, error_model="numpy", forceinline=inline, _nrt=counted,
            no_cfunc_wrapper=True,
            no_cpython_wrapper=inline and function.__name__.startswith("_"),
        )(function)  # fmt: skip
        if folder:
            numba.config.CACHE_DIR = str(folder)
            with suppress(
                RuntimeError, OSError
            ):  # it cannot be made: compiled whenever it is needed
                dispatcher._cache = _Cache(function)  # noqa: SLF001
    finally:
        numba.config.CACHE_DIR = chosen
    resolve = dispatcher.get_call_template

    def resolve_types(args: Any, kws: Any) -> Any:
        """Compile one version for all integers, where numba would compile one for each literal."""
        plain = {name: numba.types.unliteral(kind) for name, kind in kws.items()}
        return resolve(tuple(map(numba.types.unliteral, args)), plain)

    dispatcher.get_call_template = resolve_types
    KERNELS.append(dispatcher)
    return cast(F, dispatcher)
