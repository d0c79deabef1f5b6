"""Account of what an import lacked, recomputed or changed; kept in each episode's header."""

from __future__ import annotations

from collections.abc import Iterable

from safestage_eval.episode import Remark


class Account:
    """Collects the remarks on one episode; saying the same twice counts once."""

    def __init__(self) -> None:
        """Nothing to say yet."""
        self._remarks: dict[Remark, None] = {}

    def missing(self, what: str, how: str = "", *, cost: str = "", remedy: str = "") -> None:
        """The source does not have it. ``cost``: what that leaves open; ``remedy``: what supplies it."""
        self._add(Remark(kind="missing", what=what, how=how, cost=cost, remedy=remedy))

    def recomputed(self, what: str, how: str = "", *, cost: str = "", remedy: str = "") -> None:
        """Derived from what the source has, in the way that ``how`` says."""
        self._add(Remark(kind="recomputed", what=what, how=how, cost=cost, remedy=remedy))

    def guessed(self, what: str, how: str = "", *, cost: str = "", remedy: str = "") -> None:
        """Assumed, with nothing in the source that says so."""
        self._add(Remark(kind="guessed", what=what, how=how, cost=cost, remedy=remedy))

    @property
    def remarks(self) -> tuple[Remark, ...]:
        """All of them: what is missing first, then what was recomputed, then what was guessed."""
        order = ("missing", "recomputed", "guessed")
        return tuple(sorted(self._remarks, key=lambda remark: order.index(remark.kind)))

    def _add(self, remark: Remark) -> None:
        self._remarks[remark] = None


def summed(accounts: Iterable[tuple[Remark, ...]]) -> list[tuple[Remark, int]]:
    """Each remark once, with the number of episodes that have it; the most frequent first."""
    counts: dict[Remark, int] = {}
    for account in accounts:
        for remark in account:
            counts[remark] = counts.get(remark, 0) + 1
    return sorted(counts.items(), key=lambda item: -item[1])
