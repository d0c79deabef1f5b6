"""Command lines of installed Python packages, run by this interpreter."""

from __future__ import annotations

import subprocess
import sys

from safestage_eval.errors import InputError


def run_module(module: str, *arguments: str) -> None:
    """Run ``python -m MODULE ARGUMENTS``.

    Raises:
        InputError: it failed; with the last line that it printed.
    """
    done = subprocess.run(  # noqa: S603 — arguments of our own
        [sys.executable, "-m", module, *arguments], capture_output=True, text=True, check=False
    )
    if done.returncode:
        last = (done.stderr.strip().splitlines() or [""])[-1]
        raise InputError(" ".join((module, *arguments[:2])), f"failed: {last}")
