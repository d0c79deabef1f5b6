"""How numba compiles kernels, and loads what it compiled before."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numba
from numba.core import caching
from numba.core.runtime.nrt import rtsys

from .kernel_folder import cache_folder

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


def make_dispatcher(function: Callable[..., Any], *, inline: bool, counted: bool) -> Any:
    """Return numba's dispatcher of a kernel (see ``compiled``): compiles for types it has not met."""
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
    return dispatcher
