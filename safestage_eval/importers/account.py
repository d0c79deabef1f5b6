"""Account of what an import lacked, recomputed or changed; kept in each episode's header."""

from __future__ import annotations

from collections.abc import Iterable

from safestage_eval.episode import Remark


class Account:
    """Collects the remarks on one episode; equal remarks count once."""

    def __init__(self) -> None:
        """Start without remarks."""
        self._remarks: dict[Remark, None] = {}

    def missing(self, what: str, how: str = "", *, cost: str = "", remedy: str = "") -> None:
        """Remark on data that the source lacks. ``cost``: the consequences; ``remedy``: how to supply it."""
        self._add(Remark(kind="missing", what=what, how=how, cost=cost, remedy=remedy))

    def recomputed(self, what: str, how: str = "", *, cost: str = "", remedy: str = "") -> None:
        """Remark on data derived from the source; ``how``: by which method."""
        self._add(Remark(kind="recomputed", what=what, how=how, cost=cost, remedy=remedy))

    def guessed(self, what: str, how: str = "", *, cost: str = "", remedy: str = "") -> None:
        """Remark on an assumption that nothing in the source supports."""
        self._add(Remark(kind="guessed", what=what, how=how, cost=cost, remedy=remedy))

    @property
    def remarks(self) -> tuple[Remark, ...]:
        """All remarks: missing data first, then recomputed, then guessed."""
        order = ("missing", "recomputed", "guessed")
        return tuple(sorted(self._remarks, key=lambda remark: order.index(remark.kind)))

    def _add(self, remark: Remark) -> None:
        self._remarks[remark] = None


def summed(accounts: Iterable[tuple[Remark, ...]]) -> list[tuple[Remark, int]]:
    """Count the episodes with each remark; the most frequent first."""
    counts: dict[Remark, int] = {}
    for account in accounts:
        for remark in account:
            counts[remark] = counts.get(remark, 0) + 1
    return sorted(counts.items(), key=lambda item: -item[1])
