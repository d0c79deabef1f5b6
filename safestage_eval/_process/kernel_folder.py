"""Which kernels are compiled ahead, and where their machine code is kept. Loads no compiler.

Numba's own cache looks only at the file of the function it compiles: a kernel that calls an edited
helper in another file would keep the old helper. So the cache folder is named after the content of
all files of the kernel's room (its folder), and stale machine code can never answer. Kernels
therefore call no kernels of another room.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
import sys
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

SIGNATURES = Path(__file__).with_name("kernel_signatures.json")
COMPILER = Path(__file__).with_name("kernel_compiler.py")

HARMLESS = ("NUMBA_CACHE_DIR", "NUMBA_NUM_THREADS", "NUMBA_THREADING_LAYER")
"""Settings of numba under which it compiles the same machine code."""

Signatures = dict[str, dict[str, list[Any]]]
"""Module → kernel → lists of argument types as JSON."""


def read_signatures() -> Signatures:
    """The kernels that Python calls, and the types that it calls them with."""
    data: Signatures = json.loads(SIGNATURES.read_bytes())
    return data


@cache
def cache_name(room: Path) -> str:
    """Name of the folder of a room's machine code, after the content of its sources."""
    digest = hashlib.sha256(COMPILER.read_bytes())
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


@cache
def stamp() -> Path | None:
    """The file that says that all listed kernels are compiled for this version and processor.

    None where nothing can be kept.
    """
    host = processor(), platform.machine(), sys.version
    digest = hashlib.sha256(repr((host, settings())).encode())
    for library in ("numba", "llvmlite"):
        digest.update((package_folder(library) / "_version.py").read_bytes())
    digest.update(SIGNATURES.read_bytes())
    above = Path(__file__).parents[2]
    for room in sorted({module.rpartition(".")[0] for module in read_signatures()}):
        digest.update(cache_name(above / room.replace(".", "/")).encode())
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    folder = Path(chosen) if chosen else cache_folder(Path(__file__).parent)
    return folder and folder / f"all-{digest.hexdigest()[:12]}.compiled"


def processor() -> tuple[str, str, str]:
    """System, name and features of the processor that kernels are compiled for, as numba chooses it."""
    from llvmlite import binding

    name = os.environ.get("NUMBA_CPU_NAME") or binding.get_host_cpu_name()
    features = os.environ.get("NUMBA_CPU_FEATURES")
    if features is None:
        features = "" if name == "generic" else binding.get_host_cpu_features().flatten()
    return binding.get_process_triple(), name, features


def settings() -> list[tuple[str, str]]:
    """Settings of numba by environment variables and by file, which may change machine code."""
    variables = [each for each in sorted(os.environ.items()) if each[0].startswith("NUMBA_")]
    variables = [each for each in variables if each[0] not in HARMLESS]
    file = Path(".numba_config.yaml")
    if file.is_file():
        variables.append((file.name, file.read_text("utf-8", errors="replace")))
    return variables


def package_folder(name: str) -> Path:
    """Folder of an installed package, which is not imported. Raises ImportError."""
    spec = find_spec(name)
    if spec is None or spec.origin is None:
        raise ImportError(f"no package {name!r}")
    return Path(spec.origin).parent
