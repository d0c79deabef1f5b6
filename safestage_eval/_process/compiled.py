"""Functions that run as machine code.

Whatever calls them loads no compiler as long as this machine has compiled them for the types that they
are called with (``machine_code``); for other types, numba compiles them when they are called.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import cached_property, update_wrapper
from itertools import count
from typing import TYPE_CHECKING, Any, TypeVar, cast

if TYPE_CHECKING:
    from .kernel_arguments import Check

F = TypeVar("F", bound=Callable[..., Any])

MANY = 400_000
"""Calls of a kernel. From then on numba chooses the version for the arguments: that costs a microsecond
less than choosing it here, but half a second to load."""

KERNELS: list[Kernel] = []
"""Every kernel that was imported."""


class Kernel:
    """A function that is compiled.

    Attributes:
        py_func: in Python.
        inline: its code goes into its callers.
        counted: references to arrays are counted, so it may make some.
    """

    def __init__(self, function: Callable[..., Any], *, inline: bool, counted: bool) -> None:
        """See ``kernel``, ``helper`` and ``allocating``."""
        self.py_func, self.inline, self.counted = function, inline, counted
        self._linked: Sequence[tuple[Check, Callable[..., Any]]] | None = None
        self._calls = count()
        update_wrapper(self, function)

    def __call__(self, *args: Any, **named: Any) -> Any:
        """Run it. Raises TypeError for types that it cannot be compiled for."""
        linked = self._linked
        if linked is None:
            linked = self._linked = self._versions()
        if not named:
            for suits, call in linked:
                if suits(args):
                    if next(self._calls) > MANY:
                        self._linked = ()
                    return call(*args)
        return self.dispatcher(*args, **named)

    def _versions(self) -> Sequence[tuple[Check, Callable[..., Any]]]:
        """What this machine has compiled: checks of arguments, and what to call with such."""
        from . import machine_code
        from .kernel_arguments import fits

        known, own = [], (self.py_func.__module__, self.py_func.__name__)
        for types, call in machine_code.load().get(own, ()):
            with suppress(ValueError, ImportError, AttributeError):
                known.append((fits(types), call))
        return known

    @cached_property
    def dispatcher(self) -> Any:
        """Numba's, which compiles for any types."""
        return self._dispatcher(called=True)

    @cached_property
    def inner(self) -> Any:
        """The same for kernels that call this one."""
        return self._dispatcher(called=False)

    def _dispatcher(self, *, called: bool) -> Any:
        from .kernel_compiler import make_dispatcher

        return make_dispatcher(
            self.py_func, inline=self.inline, counted=self.counted, called=called
        )

    def load(self, types: tuple[Any, ...]) -> None:
        """Compile for types of numba, or load what was compiled; from now on numba runs it.

        Raises:
            numba.core.errors.NumbaError, TypeError: it cannot be compiled for them.
        """
        self.dispatcher.compile(types)
        self._linked = ()

    @property
    def _numba_type_(self) -> Any:
        """What a kernel that calls this one takes it for."""
        return self.inner._numba_type_


def kernel(function: F) -> F:
    """Compile with IEEE arithmetic (no fast-math) to run without the GIL, and keep it.

    References to arrays are not counted: whoever calls it holds them until it returns. Counting
    them, at every row of an array that is looked at, took four fifths of a distance. So it cannot
    allocate (that is an error when it is compiled); what must is ``allocating``.
    """
    return _compiled(function, inline=False)


def helper(function: F) -> F:
    """As kernel, for a small function: its code goes into its callers.

    A call hands over every array of a named tuple, which takes longer than such a function.
    """
    return _compiled(function, inline=True)


def allocating(function: F) -> F:
    """As kernel, for a function that makes arrays of its own."""
    return _compiled(function, inline=False, counted=True)


def _compiled(function: F, *, inline: bool, counted: bool = False) -> F:
    made = Kernel(function, inline=inline, counted=counted)
    KERNELS.append(made)
    return cast(F, made)
