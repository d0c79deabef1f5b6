"""References to stored episodes that are not opened yet."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from safestage_eval._process.within import within_limits
from safestage_eval.episode import Episode
from safestage_eval.errors import TraceError, readable

Format = Literal["parquet", "mcap", "zip"]


@dataclass(frozen=True)
class EpisodeRef:
    """Where an episode is and what its header says in short; small and picklable.

    Attributes:
        path: the MCAP or ZIP file, or the file of ``meta/episodes`` that holds its row.
        format: of the file.
        episode_id: from the header; empty when it could not be read.
        episode_index: its key in a Parquet dataset; None elsewhere.
        fields: the header's scalar fields and ``content_hash`` as stored, by name.
        problem: why it cannot be opened, if that is already known.
        stored_in: name of the files that hold its rows in a Parquet dataset; None elsewhere.
    """

    path: Path
    format: Format
    episode_id: str = ""
    episode_index: int | None = None
    fields: Mapping[str, Any] = field(default_factory=dict)
    problem: TraceError | None = None
    stored_in: str | None = None

    @property
    def shown(self) -> str:
        """The path as results and messages show it."""
        return readable(self.path)

    @property
    def content_hash(self) -> str | None:
        """The hash that the file states; ``validate`` compares it with the content."""
        return self.fields.get("content_hash")

    def open(self, *, recover: bool = False, checked: bool = True) -> Episode:
        """Open the episode; arguments as for ``load``. Raises TraceError when it is broken."""
        if self.problem is not None and not (recover and self.format == "mcap"):
            raise self.problem
        with within_limits(self.shown):
            return self._open(recover=recover, checked=checked)

    def _open(self, *, recover: bool, checked: bool) -> Episode:
        if self.format == "mcap":
            from .mcap.mcap_reader import read_mcap

            return read_mcap(self.path, recover=recover, checked=checked)
        if self.format == "zip":
            from .zip_reader import read_zip

            return read_zip(self.path, checked=checked)
        from .parquet.dataset_reader import open_episode

        assert self.episode_index is not None
        return open_episode(self.path, self.episode_index, checked=checked)
