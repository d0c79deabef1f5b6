"""Bounds on processor time and memory while a block runs, in this process."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

from safestage_eval.errors import TraceError
from safestage_eval.size_limits import current

from .memory_limit import allocated

AGAIN = 1.0
"""s of processor time after which a block that went on is interrupted once more."""

_inside = False


@contextmanager
def within_limits(where: str) -> Iterator[None]:
    """Read or judge one episode within the limits of time and memory; a block inside another has none of its own.

    Time is looked at between instructions of Python, so a library that does not come back is not
    interrupted: worker processes are ended for that. Only the main thread can be.

    Raises:
        TraceError: it takes more. A block that catches it meets it again.
    """
    global _inside  # noqa: PLW0603 - the process's own clock and bound
    if _inside or threading.current_thread() is not threading.main_thread():
        yield
        return
    limits = current()
    with ExitStack() as held:
        _inside = True
        held.callback(_leave)
        _bound_time(limits.seconds, where, held)
        _bound_memory(limits.memory, held)
        try:
            yield
        except MemoryError:
            raise TraceError(
                where, f"it takes more than {limits.memory / 2**20:,.0f} MiB of memory.",
                fix="if it is no mistake, raise the limit: --limits memory=SIZE",
            ) from None  # fmt: skip


def _leave() -> None:
    global _inside  # noqa: PLW0603
    _inside = False


def _bound_time(seconds: int, where: str, held: ExitStack) -> None:
    if seconds > 1 << 30 or not hasattr(signal, "setitimer"):
        return
    if signal.getsignal(signal.SIGPROF) not in (signal.SIG_DFL, None):
        return  # somebody measures this process

    def late(*_: Any) -> None:
        raise TraceError(
            where, f"it takes more than {seconds} s of processor time.",
            fix="if it is no mistake, raise the limit: --limits seconds=NUMBER",
        )  # fmt: skip

    signal.signal(signal.SIGPROF, late)
    signal.setitimer(signal.ITIMER_PROF, seconds, AGAIN)
    held.callback(signal.signal, signal.SIGPROF, signal.SIG_DFL)
    held.callback(signal.setitimer, signal.ITIMER_PROF, 0)


def _bound_memory(memory: int, held: ExitStack) -> None:
    """Let allocation fail beyond the limit, which libraries report, instead of the system ending processes."""
    try:
        import resource
    except ImportError:
        return
    soft, hard = resource.getrlimit(resource.RLIMIT_DATA)
    there = allocated()
    wanted = there + memory
    if not there or wanted > 1 << 60 or (soft != resource.RLIM_INFINITY and soft <= wanted):
        return
    if hard != resource.RLIM_INFINITY and hard < wanted:
        return
    resource.setrlimit(resource.RLIMIT_DATA, (wanted, hard))
    held.callback(resource.setrlimit, resource.RLIMIT_DATA, (soft, hard))
