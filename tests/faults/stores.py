"""Object stores that are slow, fail now and then, or fail from some moment on, while traces are scored."""

from __future__ import annotations

import random
import shutil
from collections.abc import Callable
from pathlib import Path

from aftermath import Row, after
from child import Child
from victims import StoreScorer

ALL = {0}
"""Exit codes: everything was judged."""
SOME = {0, 2}
"""Episodes that could not be read are listed."""


def slow_store(victim: StoreScorer, times: int, chance: random.Random, place: Path) -> Row:
    """Every answer takes up to half a second longer: it takes longer, no more."""

    def slow() -> None:
        victim.store.delay = chance.uniform(0.05, 0.5)

    return _scored(victim, "answers take longer", times, place, slow, ALL)


def failing_store(victim: StoreScorer, times: int, chance: random.Random, place: Path) -> Row:
    """One answer of seven is refused (503) or breaks off: it is asked for again."""

    def fail() -> None:
        victim.store.failing = lambda number, path: chance.random() < 1 / 7

    return _scored(victim, "answers fail now and then", times, place, fail, SOME)


def throttling_store(victim: StoreScorer, times: int, chance: random.Random, place: Path) -> Row:
    """One answer of five is refused because too much is asked for (429, 503), and to be asked for again."""

    def throttle() -> None:
        victim.store.ways = (429, 503)
        victim.store.failing = lambda number, path: chance.random() < 1 / 5

    return _scored(victim, "too much is asked for (429, 503)", times, place, throttle, SOME)


def short_store(victim: StoreScorer, times: int, chance: random.Random, place: Path) -> Row:
    """One answer of five has fewer bytes than were asked for, and says so: never another verdict."""

    def shorten() -> None:
        victim.store.ways = ("short",)
        victim.store.failing = lambda number, path: chance.random() < 1 / 5

    return _scored(victim, "ranges come back shorter than asked", times, place, shorten, SOME)


def broken_store(victim: StoreScorer, times: int, chance: random.Random, place: Path) -> Row:
    """From some request on everything fails: what was judged stays, the rest is a problem."""
    store = victim.store
    place.mkdir()
    store.calm()
    whole = Child(victim, place / "data")
    assert whole.wait() == 0, whole.said()
    whole.committed()
    most = store.count

    def fail() -> None:
        last = chance.randrange(most)
        store.failing = lambda number, path: number > last

    return _scored(victim, "fails for good from some moment on", times, place, fail, SOME)


def _scored(
    victim: StoreScorer,
    fault: str,
    times: int,
    place: Path,
    begin: Callable[[], None],
    allowed: set[int],
) -> Row:
    """Score under a fault; whatever part of the results is there must be right, and stay."""
    row, store, folder = Row(victim.name, fault), victim.store, place / "data"
    place.mkdir(exist_ok=True)
    for _ in range(times):
        shutil.rmtree(folder, ignore_errors=True)
        store.calm()
        begin()
        child = Child(victim, folder)
        code = child.wait()
        child.committed()
        row.tried += 1
        row.hit += bool(store.failed or store.delay)
        if code not in allowed:
            row.next_failed += 1
            row.said.add(f"exit code {code}: {child.said()}")
        store.calm()
        after(row, victim, folder, victim.left(folder) if code else victim.everything)
    return row
