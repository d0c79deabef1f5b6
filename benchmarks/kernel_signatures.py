"""Which kernels Python calls, and with which types: what is compiled before the first verdict.

    python benchmarks/kernel_signatures.py traces/ --write     # after kernels were added or changed

Judges the traces in this process as ``safestage score`` does, by all rules and by the assigned ones, and
compares the kernels that Python called with those in ``kernel_signatures.json``; with ``--write``, adds
what is missing there and removes kernels that are no longer there.
"""

from __future__ import annotations

import argparse
import importlib
import json
from pathlib import Path
from typing import Any

from safestage_eval._process import compiled
from safestage_eval._process.kernel_folder import SIGNATURES, read_signatures
from safestage_eval._process.kernel_types import to_json
from safestage_eval.audit.audit_scores import look
from safestage_eval.formats import discover
from safestage_eval.rules import builtin_names
from safestage_eval.run.score_many import score_many
from safestage_eval.run.settings import load_settings

Signatures = dict[str, dict[str, list[Any]]]


def called() -> Signatures:
    """Kernels that this process called, or loaded, with the types they are compiled for."""
    found: Signatures = {}
    for kernel in compiled.KERNELS:
        function = kernel.py_func
        for types in kernel.dispatcher.signatures:
            kinds = found.setdefault(function.__module__, {}).setdefault(function.__name__, [])
            kinds.append([to_json(kind) for kind in types])
    return found


def missing(known: Signatures, found: Signatures) -> list[tuple[str, str, Any]]:
    """Signatures that were called and are not listed."""
    return [
        (module, name, types)
        for module, kernels in found.items()
        for name, all_types in kernels.items()
        for types in all_types
        if types not in known.get(module, {}).get(name, [])
    ]


def merged(known: Signatures, found: Signatures) -> Signatures:
    """Both, without kernels that are gone; sorted."""
    both: Signatures = {}
    for module, name, types in [*missing({}, known), *missing(known, found)]:
        if _there(module, name):
            both.setdefault(module, {}).setdefault(name, []).append(types)
    return {m: dict(sorted(kernels.items())) for m, kernels in sorted(both.items())}


def write(signatures: Signatures) -> None:
    """One line per signature."""
    lines = []
    for module, kernels in signatures.items():
        inner = [
            f"  {json.dumps(name)}: [\n   "
            + ",\n   ".join(json.dumps(t, separators=(",", ":")) for t in sorted(types, key=str))
            + "\n  ]"
            for name, types in kernels.items()
        ]
        lines.append(f" {json.dumps(module)}: {{\n" + ",\n".join(inner) + "\n }")
    SIGNATURES.write_text("{\n" + ",\n".join(lines) + "\n}\n", "utf-8")


def _there(module: str, name: str) -> bool:
    try:
        return hasattr(importlib.import_module(module), name)
    except ImportError:
        return False


def main() -> None:
    """Judge, compare, print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("traces", nargs="+", type=Path)
    parser.add_argument("--write", action="store_true")
    args = parser.parse_args()
    refs = discover(args.traces)
    for assigned in (False, True):
        settings = load_settings(builtin_names(), assigned_only=assigned).copy_with(look=look)
        score_many(refs, settings=settings, jobs=1)
    known = read_signatures() if SIGNATURES.exists() else {}
    new = missing(known, called())
    for module, name, types in new:
        print(f"not listed: {module}.{name} {json.dumps(types)}")
    print(f"{len(refs)} episodes; {len(new)} signatures are not listed")
    if args.write:
        write(merged(known, called()))


if __name__ == "__main__":
    main()
