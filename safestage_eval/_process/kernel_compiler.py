"""How numba compiles kernels, and loads what it compiled before."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numba
from numba.core import caching
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler_lock import global_compiler_lock
from numba.core.environment import lookup_environment
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


class _Library(JITCodeLibrary):  # type: ignore[misc]
    """Code of a function, optimised together with all that it calls once its address is asked for.

    Numba optimises each function and generates its machine code, and does both again within every
    function that calls it: more than half of the time that compiling took. What only kernels call
    has no address.
    """

    whole = emitted = False

    def _optimize_functions(self, ll_module: Any) -> None:
        """Leave that to ``_emit``."""
        ll_module.data_layout = self._codegen._data_layout  # noqa: SLF001

    def finalize(self) -> None:
        """Nothing is added to it from now on."""
        self._raise_if_finalized()
        self._reload_init.update(*(each._reload_init for each in self._linking_libraries))  # noqa: SLF001
        self._finalized = True

    def _parts(self) -> list[JITCodeLibrary]:
        """Libraries of all that it calls, at whatever depth, callers before what they call.

        LLVM takes in only functions that something in the module calls already.
        """
        order: dict[JITCodeLibrary, None] = {}

        def visit(library: JITCodeLibrary) -> None:
            for each in library._linking_libraries if isinstance(library, _Library) else ():  # noqa: SLF001
                if each not in order:
                    visit(each)
            order[library] = None

        visit(self)
        return list(order)[-2::-1]

    def _own_module(self) -> Any:
        """Code of the function itself, which any number of others may take in."""
        return super()._get_module_for_linking()

    def _link(self) -> None:
        """Take in the code of all that it calls."""
        self._ensure_finalized()
        if self.whole:
            return
        for library in self._parts():
            own = isinstance(library, _Library) and not library.whole
            module = library._own_module() if own else library._get_module_for_linking()  # noqa: SLF001
            self._final_module.link_in(module, preserve=True)
        self.whole, self._shared_module = True, None

    def _get_module_for_linking(self) -> Any:
        self._link()
        return super()._get_module_for_linking()

    def _emit(self) -> None:
        """Optimise it and generate machine code, once."""
        if self.emitted:
            return
        self._link()
        self._codegen._check_llvm_bugs()  # noqa: SLF001
        self._optimize_final_module()
        self._final_module.verify()
        self._finalize_final_module()
        for variable in self._final_module.global_variables:
            if (environment := lookup_environment(variable.name)) is not None:
                self._codegen.set_env(variable.name, environment)

    def _finalize_final_module(self) -> None:
        """Hand it to LLVM's linker; what comes from disk is whole."""
        self.whole = self.emitted = True
        super()._finalize_final_module()

    def get_pointer_to_function(self, name: str) -> int:
        """Address of a function; 0 where it has none, as the wrapper of what only kernels call."""
        self._ensure_finalized()
        try:
            (self._shared_module or self._final_module).get_function(name)
        except NameError:
            return 0
        self._emit()
        return int(super().get_pointer_to_function(name))

    def _get_compiled_object(self) -> Any:
        self._emit()
        return super()._get_compiled_object()


@contextmanager
def _own_libraries(codegen: Any) -> Iterator[None]:
    """Compile into ``_Library`` meanwhile; functions without an address have no environment to be told."""
    tell = codegen.set_env

    def set_env(name: str, environment: Any) -> None:
        if codegen._engine.is_symbol_defined(name):  # noqa: SLF001
            tell(name, environment)

    with global_compiler_lock:
        kept = dict(vars(codegen))
        codegen._library_class, codegen.set_env = _Library, set_env  # noqa: SLF001
        try:
            yield
        finally:
            for name in ("_library_class", "set_env"):
                if name in kept:
                    setattr(codegen, name, kept[name])
                else:
                    delattr(codegen, name)


def make_dispatcher(
    function: Callable[..., Any], *, inline: bool, counted: bool, called: bool
) -> Any:
    """Return numba's dispatcher of a kernel (see ``compiled``): compiles for types it has not met.

    ``called``: by Python, so that it has an address and is kept; otherwise by kernels only.
    """
    dispatcher = numba.njit(
        nogil=True, error_model="numpy", forceinline=inline, _nrt=counted,
        no_cfunc_wrapper=True, no_cpython_wrapper=not called,
    )(function)  # fmt: skip
    if called:
        _keep(dispatcher, function)
    compile_one, resolve = dispatcher.compile, dispatcher.get_call_template

    def compile_types(types: Any) -> Any:
        with _own_libraries(dispatcher.targetctx.codegen()):
            return compile_one(types)

    def resolve_types(args: Any, kws: Any) -> Any:
        """Compile one version for all integers, where numba would compile one for each literal."""
        plain = {name: numba.types.unliteral(kind) for name, kind in kws.items()}
        return resolve(tuple(map(numba.types.unliteral, args)), plain)

    dispatcher.compile, dispatcher.get_call_template = compile_types, resolve_types
    return dispatcher


def _keep(dispatcher: Any, function: Callable[..., Any]) -> None:
    """Keep what it compiles, where a folder can be made; otherwise it is compiled whenever it is needed."""
    chosen = numba.config.CACHE_DIR
    folder = chosen or cache_folder(Path(function.__code__.co_filename).parent)
    if not folder:
        return
    numba.config.CACHE_DIR = str(folder)
    try:
        with suppress(RuntimeError, OSError):
            dispatcher._cache = _Cache(function)  # noqa: SLF001
    finally:
        numba.config.CACHE_DIR = chosen
