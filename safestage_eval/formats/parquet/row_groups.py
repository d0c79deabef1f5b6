"""The row groups of a Parquet file, and whose rows each of them holds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, overload

KEYS: dict[str, type] = {"episode_index": int, "body": str, "body1": str, "body2": str}
"""Columns that rows are looked up by, and what they hold."""


class Group(NamedTuple):
    """A row group: its number, its rows, and the least and greatest of each key that it states."""

    number: int
    rows: int
    limits: dict[str, tuple[Any, Any]]

    def single(self, key: str) -> Any:
        """The only value of a key; None where there are several, or the file does not say."""
        least, greatest = self.limits.get(key, (None, None))
        return least if least == greatest else None

    def may_hold(self, **keys: Any) -> bool:
        """Rows with these values may be in it; None stands for any value."""
        for key, value in keys.items():
            if value is not None and key in self.limits:
                least, greatest = self.limits[key]
                if not least <= value <= greatest:
                    return False
        return True

    def only(self, **keys: Any) -> bool:
        """All of its rows have these values; None stands for any value."""
        return all(value is None or self.single(key) == value for key, value in keys.items())


Limits = Mapping[str, tuple[Sequence[Any], Sequence[Any]]]
"""Key → least and greatest of each group, None where it does not state them."""


class RowGroups(Sequence[Group]):
    """In the file's order. A shard has thousands, so each is made when it is asked for."""

    def __init__(self, rows: Sequence[int], limits: Limits) -> None:
        """``rows``: of each."""
        self._rows, self._limits = rows, limits
        self._by_episode: dict[int, list[int]] | None = None

    def __len__(self) -> int:
        return len(self._rows)

    @overload
    def __getitem__(self, number: int) -> Group: ...
    @overload
    def __getitem__(self, number: slice) -> Sequence[Group]: ...
    def __getitem__(self, number: int | slice) -> Group | Sequence[Group]:
        if isinstance(number, slice):
            return [self[i] for i in range(*number.indices(len(self)))]
        return Group(
            range(len(self))[number],
            self._rows[number],
            {
                key: (least[number], greatest[number])
                for key, (least, greatest) in self._limits.items()
                if least[number] is not None
            },
        )

    def rows(self, number: int) -> int:
        """How many rows one has."""
        return self._rows[number]

    def single(self, number: int, key: str) -> Any:
        """As ``Group.single``, of one of them."""
        if key not in self._limits:
            return None
        least, greatest = self._limits[key]
        return least[number] if least[number] == greatest[number] else None

    def of_episode(self, episode: int) -> tuple[Sequence[int], bool]:
        """Numbers of those that may hold rows of an episode, and whether they hold no other rows."""
        if self._by_episode is None:
            self._by_episode = self._sorted()
        if self._by_episode:
            return self._by_episode.get(episode, ()), True
        found = [group for group in self if group.may_hold(episode_index=episode)]
        exact = all(group.only(episode_index=episode) for group in found)
        return [group.number for group in found], exact

    def _sorted(self) -> dict[int, list[int]]:
        """Numbers by episode; empty where a group holds several, or does not say."""
        found: dict[int, list[int]] = {}
        none: Sequence[Any] = [None] * len(self)
        least, greatest = self._limits.get("episode_index", (none, none))
        for number, (first, last) in enumerate(zip(least, greatest, strict=True)):
            if first is None or first != last:
                return {}
            found.setdefault(first, []).append(number)
        return found
