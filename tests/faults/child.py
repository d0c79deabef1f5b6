"""A process that is started to be killed, or to run out of something."""

from __future__ import annotations

import os
import sys
import traceback
from collections.abc import Callable
from pathlib import Path

from victims import Victim

CRASHED = 70


class Child:
    """A victim at work in a process of its own."""

    def __init__(
        self, victim: Victim, folder: Path, before: Callable[[], None] = lambda: None
    ) -> None:
        """Forks: a process that has to load everything anew would mostly die loading."""
        self._committed, writing = os.pipe()
        self.log = folder.parents[1] / "child.log"
        self.pid = os.fork()
        if self.pid == 0:
            os.close(self._committed)
            self._work(victim, folder, writing, before)
        os.close(writing)
        self.code: int | None = None

    def _work(self, victim: Victim, folder: Path, told: int, before: Callable[[], None]) -> None:
        code = CRASHED
        try:
            out = os.open(self.log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            os.dup2(out, 1)
            os.dup2(out, 2)
            sys.stdout = os.fdopen(1, "w", buffering=1, closefd=False)
            sys.stderr = os.fdopen(2, "w", buffering=1, closefd=False)
            before()
            code = victim.go(folder, lambda name: os.write(told, f"{name}\n".encode()) and None)
        except BaseException:  # noqa: BLE001 — the exit code tells, and the log
            traceback.print_exc()
        finally:
            os._exit(code)

    def kill(self) -> None:
        """End at once and silently, like the system when memory runs out."""
        os.kill(self.pid, 9)

    def ended(self) -> bool:
        """Whether it has ended by now; does not wait."""
        if self.code is None:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            if pid:
                self.code = os.waitstatus_to_exitcode(status)
        return self.code is not None

    def wait(self) -> int:
        """The exit code, when it has ended."""
        if self.code is None:
            self.code = os.waitstatus_to_exitcode(os.waitpid(self.pid, 0)[1])
        return self.code

    def committed(self) -> set[str]:
        """Records that it reported as written; after its end."""
        with os.fdopen(self._committed, "rb") as stream:
            return set(stream.read().decode().split())

    def said(self) -> str:
        """The last line that it printed."""
        lines = self.log.read_text("utf-8", "replace").strip().splitlines()
        return lines[-1] if lines else ""
