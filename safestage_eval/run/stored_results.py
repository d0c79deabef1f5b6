"""Results of a run that stay on disk and are read as they are looked at."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import overload

from safestage_eval.verdicts import EpisodeResult
from safestage_eval.verdicts.verdict import result_from_json

from .result_parts import Parts


class StoredResults(Sequence[EpisodeResult]):
    """A sequence that holds none of its items."""

    def __init__(
        self, parts: Parts, rows: Sequence[int], paths: Sequence[str], folder: object = None
    ) -> None:
        """``rows``: numbers of results among the parts; ``paths``: where their episodes are.

        ``folder``: of the parts, if it is to go when nobody looks at the results any more.
        """
        self._parts, self._rows, self._paths, self._folder = parts, rows, paths, folder

    def __len__(self) -> int:
        """How many there are."""
        return len(self._rows)

    @overload
    def __getitem__(self, index: int) -> EpisodeResult: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[EpisodeResult, ...]: ...
    def __getitem__(self, index: int | slice) -> EpisodeResult | tuple[EpisodeResult, ...]:
        """Read from disk. Raises InputError when a part was damaged meanwhile."""
        if isinstance(index, slice):
            return tuple(self[i] for i in range(*index.indices(len(self))))
        return result_from_json(json.loads(self._parts.line(self._rows[index])), self._paths[index])
