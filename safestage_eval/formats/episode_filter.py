"""Selection of episodes by the values of their header fields."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from safestage_eval.episode import Header
from safestage_eval.errors import InputError, did_you_mean, nearest

from .discover import aborted
from .episode_ref import EpisodeRef

SHOWN, KEPT = 12, 1000
"""How many values of a field a message names, and how many are looked through for a similar one."""

HIDDEN = {"content_hash", "file"}
"""Fields that say where an episode is, not what it is."""


class Selection:
    """Episodes whose header has the wanted values, one by one, and all that cannot be read.

    A rollout that ended in an error says nothing of its policy: it is left out, unless it is asked
    for (``termination=error``).

    Attributes:
        aborted: those met so far that ended in an error, and are left out therefore.
    """

    def __init__(self, refs: Iterable[EpisodeRef], where: Mapping[str, str] | None) -> None:
        self._refs, self._where = refs, where or {}
        self.aborted: list[str] = []

    def __iter__(self) -> Iterator[EpisodeRef]:
        """Raises InputError, after all have been met, for an unknown field and where nothing matched."""
        count, readable, matched, fields = 0, 0, False, set[str]()
        values: dict[str, dict[str, None]] = {name: {} for name in self._where}
        errors = self._where.get("termination", "").lower() == "error"
        for ref in self._refs:
            count += 1
            if aborted(ref) and not errors:
                self.aborted.append(ref.episode_id or ref.shown)
            elif ref.problem is not None or not self._where:
                matched = matched or not self._where
                yield ref
            else:
                readable += 1
                fields |= ref.fields.keys()
                if readable == 1:  # a misspelt name is reported before the others are looked at
                    self._check({"episode_id", *fields, *Header.model_fields} - HIDDEN, fields)
                if self._meant(ref, values):
                    matched = True
                    yield ref
        if count and len(self.aborted) == count:
            raise InputError(
                f"{count} episodes", "every one of them ended in an error.",
                fix="record them again, or judge them all the same with --where termination=error",
            )  # fmt: skip
        if readable and not matched:
            self._check({"episode_id", *fields} - HIDDEN, fields)
        if not matched:
            raise self._none(count, values)

    def _meant(self, ref: EpisodeRef, values: Mapping[str, dict[str, None]]) -> bool:
        """True if an episode has all wanted values; collects the values that there are."""
        meant = True
        for name, wanted in self._where.items():
            here = ref.episode_id if name == "episode_id" else ref.fields.get(name)
            text = "" if here is None else str(here)
            if len(values[name]) < KEPT:
                values[name][text] = None
            meant = meant and text.lower() == wanted.lower() and (bool(text) or not wanted)
        return meant

    def _check(self, possible: set[str], there: set[str]) -> None:
        for name, value in self._where.items():
            if name not in possible:
                allowed = sorted({"episode_id", *there} - HIDDEN)
                raise InputError(
                    f"{name}={value}",
                    f"no field {name!r}.",
                    ", ".join(allowed),
                    did_you_mean(name, allowed),
                )

    def _none(self, count: int, values: Mapping[str, dict[str, None]]) -> InputError:
        wanted = " and ".join(f"{name}={value}" for name, value in self._where.items())
        allowed, near = [], []
        for name, there in values.items():
            present = sorted(filter(None, there))
            spelt = {text.lower(): text for text in present}
            if similar := nearest(self._where[name].lower(), spelt):
                near.append(f'"{name}={spelt[similar]}"')
            more = f", and {len(present) - SHOWN:,} more" if len(present) > SHOWN else ""
            if present:
                allowed.append(f"{name} {', '.join(present[:SHOWN])}{more}")
        return InputError(
            wanted,
            f"none of {count} episodes matches.",
            "; ".join(allowed),
            f"did you mean {' and '.join(near)}?" if near and len(values) == 1 else "",
        )
