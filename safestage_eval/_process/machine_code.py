"""Machine code of all listed kernels in one file, linked without loading numba.

Loading numba and then each kernel from its own cache took a third of what a process does up to its
first verdict. What numba compiled are object files; LLVM links all of them in a few milliseconds. They call
functions of numba's extension modules, which are loaded without the rest of numba. If anything
is not as expected, there is no machine code here, and kernels are loaded by numba.
"""

from __future__ import annotations

import builtins
import ctypes
import json
import os
import sys
import threading
import zlib
from collections.abc import Callable, Iterable
from importlib import import_module
from importlib.machinery import PathFinder
from importlib.util import module_from_spec
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from .kernel_folder import package_folder, stamp

Native = Callable[..., Any]

SUFFIX = ".kernels"
"""Of the file that has the machine code of all kernels."""

TRIAL_TIME = 60.0
"""s that linking may take when it is tried."""


class Compiled(NamedTuple):
    """A kernel compiled for one list of argument types.

    Attributes:
        module: that defines it.
        name: of the kernel.
        types: of its arguments, as in ``kernel_signatures.json``.
        symbol: of the function in ``code`` that Python calls.
        environments: variables of ``code`` that stand for what functions look up in Python, which are
            names of dtypes: variable → dtypes.
        code: an object file.
    """

    module: str
    name: str
    types: list[Any]
    symbol: str
    environments: dict[str, list[str]]
    code: bytes


class Linked(NamedTuple):
    """A compiled kernel that can be called with arguments of exactly its types."""

    types: list[Any]
    call: Native


def file() -> Path | None:
    """Where the machine code is, or would be; None where nothing can be kept."""
    done = stamp()
    return done and done.with_suffix(SUFFIX)


def save(path: Path, kernels: Iterable[Compiled], library: Iterable[str]) -> None:
    """Write machine code as it is.

    Args:
        path: of the file.
        kernels: what is written.
        library: functions of the C library that it may call.

    Raises:
        OSError: the file cannot be written.
    """
    kernels = list(kernels)
    code = b"".join(kernel.code for kernel in kernels)
    listed = [[*kernel[:-1], len(kernel.code)] for kernel in kernels]
    head = {"library": list(library), "checksum": zlib.crc32(code), "kernels": listed}
    path.write_bytes(json.dumps(head).encode() + b"\n" + code)


def join(parts: Iterable[Path], path: Path) -> None:
    """Make one file of several, at once or not at all, if a new process can link it.

    Raises:
        OSError, ValueError, KeyError: a part is not there or damaged, or the file cannot be written.
    """
    import subprocess

    kernels, library = [], dict[str, None]()
    for part in parts:
        found, functions = read(part)
        kernels += found
        library |= dict.fromkeys(functions)
    draft = path.with_suffix(f".{os.getpid()}")
    try:
        save(draft, kernels, library)
        program = (
            f"import pathlib, sys; from {__name__} import link; link(pathlib.Path(sys.argv[1]))"
        )
        command = [sys.executable, "-c", program, str(draft)]
        quiet = subprocess.DEVNULL
        subprocess.run(command, check=True, stdout=quiet, stderr=quiet, timeout=TRIAL_TIME)  # noqa: S603 — this package itself
        draft.replace(path)
    except subprocess.SubprocessError:  # LLVM ends a process that it cannot link
        return
    finally:
        draft.unlink(missing_ok=True)


def read(path: Path) -> tuple[list[Compiled], list[str]]:
    """Kernels of a file, and the functions of the C library that they may call.

    Raises:
        OSError, ValueError, KeyError: there is no such file, or it is damaged.
    """
    head, _, code = path.read_bytes().partition(b"\n")
    data = json.loads(head)
    if zlib.crc32(code) != data["checksum"]:
        raise ValueError(f"damaged: {path}")
    kernels, place = [], 0
    for module, name, types, symbol, environments, size in data["kernels"]:
        own = code[place : place + size]
        kernels.append(Compiled(module, name, types, symbol, environments, own))
        place += size
    return kernels, data["library"]


def link(path: Path) -> dict[tuple[str, str], list[Linked]]:
    """Make the kernels of a file callable.

    Returns:
        (module, kernel) → each of its compiled versions.

    Raises:
        OSError, ValueError, KeyError: there is no such file, or it is damaged.
        ImportError, AttributeError, RuntimeError: another numba or llvmlite than this was written for.
    """
    from llvmlite import binding

    kernels, library = read(path)
    helpers, runtime, functions = (
        _extension(name)
        for name in ("numba._helperlib", "numba.core.runtime._nrt_python", "numba._dynfunc")
    )
    for name, address in _symbols(helpers, runtime, functions, library).items():
        binding.add_symbol(name, address)
    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    target = binding.Target.from_triple(binding.get_process_triple())
    machine = target.create_target_machine(codemodel="jitdefault", jit=True)
    engine = binding.create_mcjit_compiler(binding.parse_assembly(""), machine)
    for kernel in kernels:
        engine.add_object_file(binding.ObjectFileRef.from_data(kernel.code))
    engine.finalize_object()
    linked: dict[tuple[str, str], list[Linked]] = {}
    for kernel in kernels:
        address = engine.get_function_address(kernel.symbol)
        if not address:
            raise ValueError(f"no {kernel.symbol} in {path}")
        own, held = functions.Environment({}), []
        for symbol, dtypes in kernel.environments.items():
            held.append(functions.Environment({}))
            held[-1].consts.extend(map(np.dtype, dtypes))
            if place := engine.get_global_value_address(symbol):
                ctypes.c_void_p.from_address(place).value = id(held[-1])
        call = functions.make_function(sys, kernel.name, "", address, own, (engine, held))
        linked.setdefault((kernel.module, kernel.name), []).append(Linked(kernel.types, call))
    return linked


def _extension(name: str) -> ModuleType:
    """One of numba's extension modules; numba itself stays out unless it was imported before."""
    if "numba" in sys.modules or name in sys.modules:
        return import_module(name)
    package, *inner, _ = name.split(".")
    folder = package_folder(package).joinpath(*inner)
    spec = PathFinder.find_spec(name, [str(folder)])
    if spec is None or spec.loader is None:
        raise ImportError(f"no module {name!r}")
    module = sys.modules[name] = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _symbols(
    helpers: ModuleType, runtime: ModuleType, functions: ModuleType, library: Iterable[str]
) -> dict[str, int]:
    """Symbols that machine code calls by name, as numba names them: name → address."""
    symbols = {"_Py_NoneStruct": id(None)}
    for module in (helpers, functions):
        symbols |= {f"numba_{name}": address for name, address in module.c_helpers.items()}
    for name, address in runtime.c_helpers.items():
        symbols[name if name.startswith("_") else f"NRT_{name}"] = address
    for name, value in vars(builtins).items():
        if isinstance(value, type) and issubclass(value, BaseException):
            symbols[f"PyExc_{name}"] = id(value)
    return symbols | {name: helpers.c_helpers[name] for name in library}


_LOCK = threading.Lock()
_HERE: list[dict[tuple[str, str], list[Linked]]] = []
"""Libraries that this process has linked; empty before the first request."""


def load() -> dict[tuple[str, str], list[Linked]]:
    """Link what this machine has compiled, once per process; empty where numba has to load kernels."""
    with _LOCK:
        if not _HERE:
            _HERE.append(_link_here())
    return _HERE[0]


def is_loaded() -> bool:
    """Whether calling a kernel costs this process no more than the call."""
    return any(_HERE) or "numba" in sys.modules


def _link_here() -> dict[tuple[str, str], list[Linked]]:
    try:
        path = file()
        return {} if path is None or not path.exists() else link(path)
    except (OSError, ValueError, LookupError, ImportError, AttributeError, RuntimeError, TypeError):
        return {}
