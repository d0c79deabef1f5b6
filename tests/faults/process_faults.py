"""Faults within a process: a call of the system that fails once, rights that are not there, a clock that jumps."""

from __future__ import annotations

import ctypes
import json
import os
import random
import shutil
import stat
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from aftermath import Row, after
from child import Child
from victims import Victim

INJECTED = Path(__file__).with_name("injected")
sys.path.append(str(INJECTED))

OVERRIDES = sum(1 << number for number in (1, 2, 3))
"""Capabilities by which root reads and writes what it has no right to: dac_override, dac_read_search, fowner."""


def injected(told: dict[str, Any]) -> Callable[[], None]:
    """Return the first step of a forked process, so that it and its children have the faults."""

    def begin() -> None:
        os.environ["SAFESTAGE_FAULTS"] = json.dumps(told)
        paths = [str(INJECTED), *filter(None, [os.environ.get("PYTHONPATH")])]
        os.environ["PYTHONPATH"] = os.pathsep.join([*paths, *map(str, sys.path)])
        import importlib.util

        spec = importlib.util.spec_from_file_location(
            "faults_injected", INJECTED / "sitecustomize.py"
        )
        assert spec is not None
        assert spec.loader is not None
        spec.loader.exec_module(importlib.util.module_from_spec(spec))

    return begin


def without_rights() -> None:
    """Root, too, is bound by the rights of files from now on, in this process and those it starts."""
    if os.geteuid():
        return
    libc = ctypes.CDLL(None, use_errno=True)
    head = (ctypes.c_uint32 * 2)(0x20080522, 0)
    sets = (ctypes.c_uint32 * 6)()
    if libc.capget(head, sets):
        raise OSError(ctypes.get_errno(), "capget")
    for i in range(3):  # effective, permitted, inheritable
        sets[i] &= ~OVERRIDES & 0xFFFFFFFF
    for capability in (1, 2, 3):
        libc.prctl(24, capability, 0, 0, 0)  # out of the bounding set: not regained by exec
    if libc.capset(head, sets):
        raise OSError(ctypes.get_errno(), "capset")


def failing_disk(victim: Victim, times: int, chance: random.Random, place: Path) -> Row:
    """One call that writes fails once with an input/output error, another one each time."""
    row = Row(victim.name, "a write fails once (EIO)")
    place.mkdir()
    folder, calls = place / "data", place / "calls"
    whole = Child(victim, folder, injected({"calls": str(calls), "fail": 0}))
    assert whole.wait() == 0, whole.said()
    whole.committed()
    most = calls.stat().st_size
    for _ in range(times):
        shutil.rmtree(folder, ignore_errors=True)
        calls.unlink(missing_ok=True)
        fail = chance.randrange(1, most + 1)
        child = Child(victim, folder, injected({"calls": str(calls), "fail": fail}))
        code = child.wait()
        row.tried += 1
        row.hit += calls.stat().st_size >= fail
        ended(row, code, child)
        after(row, victim, folder, child.committed())
    return row


def denied(victim: Victim, times: int, chance: random.Random, place: Path) -> Row:
    """The process has no right to some folder or file of what is there already."""
    row = Row(victim.name, "permission denied")
    place.mkdir()
    folder = place / "data"
    for _ in range(times):
        shutil.rmtree(folder, ignore_errors=True)
        begun = Child(victim, folder)
        while not begun.ended() and not (folder.is_dir() and any(folder.iterdir())):
            pass
        begun.kill()
        begun.wait()
        before = begun.committed()
        there = [place, *(p for p in [folder, *folder.rglob("*")] if p.exists())]
        chosen = chance.choice([path for path in there if path.is_dir()])
        others = [p for p in there if p.is_file() and chance.random() < 0.3]
        modes = {path: stat.S_IMODE(path.stat().st_mode) for path in (chosen, *others)}
        chosen.chmod(0o555)
        for path in others:
            path.chmod(0o000 if chance.random() < 0.5 else 0o444)
        child = Child(victim, folder, without_rights)
        code = child.wait()
        for path, mode in modes.items():
            if path.exists():
                path.chmod(mode)
        row.tried += 1
        row.hit += code != 0
        ended(row, code, child)
        after(row, victim, folder, before | child.committed())
    return row


def jumping_clock(victim: Victim, times: int, chance: random.Random, place: Path) -> Row:
    """The clock jumps there and back, by seconds to years, while it works: nothing comes of it."""
    row = Row(victim.name, "clock jumps")
    place.mkdir()
    folder = place / "data"
    for _ in range(times):
        shutil.rmtree(folder, ignore_errors=True)
        child = Child(victim, folder, injected({"clock": chance.randrange(1 << 30)}))
        code = child.wait()
        row.tried += 1
        row.hit += 1
        if code:
            row.next_failed += 1
            row.said.add(f"exit code {code}: {child.said()}")
        after(row, victim, folder, child.committed())
    return row


def ended(row: Row, code: int, child: Child) -> None:
    """A fault is reported in words, and the exit code is that of bad input: no traceback."""
    text = child.log.read_text("utf-8", "replace")
    if code not in (0, 1, 2) or "Traceback (most recent call last)" in text:
        row.next_failed += 1
        row.said.add(f"CRASH: exit code {code}: {text[-1500:]}")
