"""Cheap digests of what a file holds, by which reading notices data that were not written with it.

A file states its content hash, SHA-256 over everything, which takes reading everything to compute.
So it also states a CRC-32 of each stored column, and a seal: SHA-256 over content hash, scene and
these CRCs. The seal is checked when a file is opened, and each column when it is read. Where
anything differs, or there is no seal (an older file, or one of another library), the content hash
is computed in full and compared. CRCs tell damage and mix-ups, not forgery: that takes the content
hash, which ``validate`` computes.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from hashlib import sha256
from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Episode, Header, check
from safestage_eval.episode.content_hash import scene_text
from safestage_eval.errors import TraceError

from .checksum import crc32

Digests = Mapping[str, Sequence[str]]
"""Table → of each row group its number of rows, and the CRCs of its columns (8 digits each)."""


def crc(values: NDArray[Any]) -> str:
    """Return the CRC-32 of numbers, integers as int32, in 8 hexadecimal digits; "" for other types."""
    if values.dtype.kind not in "biuf":
        return ""
    if values.dtype.kind in "iu" and values.dtype.itemsize > 1:
        values = values.astype("<i4", copy=False)
    return f"{crc32(np.ascontiguousarray(values)):08x}"


def seal(content_hash: str, header: Header, digests: object) -> str:
    """Return the SHA-256 (hex) that binds a content hash to the scene and to digests (JSON)."""
    parts = (
        json.dumps(content_hash),
        _quoted(scene_text(header)),
        json.dumps(digests, sort_keys=True),
    )
    return sha256(f"[{', '.join(parts)}]".encode()).hexdigest()


_quoted = lru_cache(8)(json.dumps)
"""JSON of a text that episodes share."""


def sealed(episode: Episode, digests: object) -> str:
    """Return the text that is stored: digests (JSON) and seal."""
    text = {"crc32": digests, "seal": seal(episode.content_hash, episode.header, digests)}
    return json.dumps(text, separators=(",", ":"))


def computed(episode: Episode) -> str:
    """Return the content hash. Raises TraceError for the first invariant that the episode breaks."""
    for error in check(episode):
        raise error
    return episode.content_hash


class Seal:
    """The content hash and digests that a file states, and their comparison with its content."""

    def __init__(
        self, stated: str | None, text: str | None, recompute: Callable[[], str], where: str
    ) -> None:
        """Parse the digests; nothing is compared yet.

        Args:
            stated: the content hash.
            text: digests and seal; None where there are none.
            recompute: the content hash, of everything.
            where: for messages.
        """
        self.stated, self._recompute, self._where = stated, recompute, where
        self.digests: Any = None
        self._seal = ""
        self._full: str | None = None
        if text is not None:
            try:
                record = json.loads(text)
                self.digests, self._seal = record["crc32"], str(record["seal"])
            except (ValueError, TypeError, KeyError, RecursionError):
                self.digests = {}

    @property
    def open(self) -> bool:
        """True while columns are still to be compared with their digests."""
        return self.digests is not None and self._full is None

    def check(self, header: Header) -> None:
        """Check the seal. Raises TraceError where the content hash is not of this scene and these digests."""
        if self.digests is not None and seal(self.stated or "", header, self.digests) != self._seal:
            self.differs("content_hash")

    def differs(self, part: str) -> None:
        """Recompute the content hash, because a part differs from its digest. Raises TraceError if the hash differs too."""
        if self._full is not None:
            return
        computed_hash = self._recompute()
        if computed_hash != self.stated:
            raise self._differs(part, computed_hash)
        self._full = computed_hash

    def _differs(self, part: str, computed_hash: str) -> TraceError:
        return TraceError(
            self._where,
            f"{part} is not what was written with this header: the content hash is "
            f"{computed_hash[:12]}…, stated is {(self.stated or 'none')[:12]}…",
            fix="restore the file, or record again",
        )

    def content_hash(self, episode: Episode) -> str:
        """Return the content hash: as stated, compared as far as columns were read; or computed in full.

        ``episode``: as it was read, with every invariant checked, or to be checked as the rest of
        it is read. Raises TraceError where they differ.
        """
        if self._full is None and self.digests is None:
            computed_hash = episode.content_hash
            if self.stated is not None and computed_hash != self.stated:
                raise self._differs("the content", computed_hash)
            self._full = computed_hash
        return self._full or self.stated or ""


def frame_digests(
    columns: Mapping[str, NDArray[Any]],
    t: NDArray[Any],
    points: NDArray[Any],
    counts: NDArray[Any],
) -> dict[str, str]:
    """Return the CRC-32 of each part of the messages of an MCAP file, by name.

    Packed fields, times, contacts (C,) as POINT, and how many each frame has (T,).
    """
    digests = {name: crc(values) for name, values in sorted(columns.items())}
    raw = np.ascontiguousarray(points).view(np.uint8)
    return digests | {"time": crc(t), "contacts": crc(raw), "counts": crc(counts)}
