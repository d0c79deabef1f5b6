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
    """CRC-32 of numbers, whole ones as int32; 8 hexadecimal digits. Of anything else, none."""
    if values.dtype.kind not in "biuf":
        return ""
    if values.dtype.kind in "iu" and values.dtype.itemsize > 1:
        values = values.astype("<i4", copy=False)
    return f"{crc32(np.ascontiguousarray(values).view(np.uint8).reshape(-1)):08x}"


def seal(content_hash: str, header: Header, told: object) -> str:
    """SHA-256 (hex) that binds a content hash to the scene and to digests (JSON)."""
    text = json.dumps([content_hash, scene_text(header), told], sort_keys=True)
    return sha256(text.encode()).hexdigest()


def sealed(episode: Episode, told: object) -> str:
    """The text that is stored: digests (JSON) and seal."""
    found = {"crc32": told, "seal": seal(episode.content_hash, episode.header, told)}
    return json.dumps(found, separators=(",", ":"))


def computed(episode: Episode) -> str:
    """Its content hash. Raises TraceError for the first invariant that it breaks."""
    for error in check(episode):
        raise error
    return episode.content_hash


class Seal:
    """What a file states about its content, and whether that is so."""

    def __init__(
        self, stated: str | None, text: str | None, recompute: Callable[[], str], where: str
    ) -> None:
        """As read, before anything is compared.

        Args:
            stated: the content hash.
            text: digests and seal; None where there are none.
            recompute: the content hash, of everything.
            where: for messages.
        """
        self.stated, self._recompute, self._where = stated, recompute, where
        self.told: Any = None
        self._seal = ""
        self._full: str | None = None
        if text is not None:
            try:
                found = json.loads(text)
                self.told, self._seal = found["crc32"], str(found["seal"])
            except (ValueError, TypeError, KeyError, RecursionError):
                self.told = {}

    @property
    def open(self) -> bool:
        """Columns are still to be compared with their digests."""
        return self.told is not None and self._full is None

    def check(self, header: Header) -> None:
        """Raises TraceError where the content hash is not of this scene and these digests."""
        if self.told is not None and seal(self.stated or "", header, self.told) != self._seal:
            self.differs("content_hash")

    def differs(self, what: str) -> None:
        """What is not as its digest says: raises TraceError unless all is as the hash says."""
        if self._full is not None:
            return
        found = self._recompute()
        if found != self.stated:
            raise self._differs(what, found)
        self._full = found

    def _differs(self, what: str, found: str) -> TraceError:
        return TraceError(
            self._where,
            f"{what} is not what was written with this header: the content hash is "
            f"{found[:12]}…, stated is {(self.stated or 'none')[:12]}…",
            fix="restore the file, or record again",
        )

    def content_hash(self, episode: Episode) -> str:
        """As stated and compared as far as columns were read, or computed in full.

        ``episode``: as it was read, with every invariant checked, or to be checked as the rest of
        it is read. Raises TraceError where they differ.
        """
        if self._full is None and self.told is None:
            found = episode.content_hash
            if self.stated is not None and found != self.stated:
                raise self._differs("the content", found)
            self._full = found
        return self._full or self.stated or ""


def frame_digests(
    columns: Mapping[str, NDArray[Any]],
    t: NDArray[Any],
    points: NDArray[Any],
    counts: NDArray[Any],
) -> dict[str, str]:
    """Of what the messages of an MCAP file hold.

    Packed fields, times, contacts (C,) as POINT, and how many each frame has (T,).
    """
    found = {name: crc(values) for name, values in sorted(columns.items())}
    raw = np.ascontiguousarray(points).view(np.uint8)
    return found | {"time": crc(t), "contacts": crc(raw), "counts": crc(counts)}
