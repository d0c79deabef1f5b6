"""The metadata record of an MCAP trace, which stands before its messages."""

from __future__ import annotations

import json
from collections.abc import Mapping
from hashlib import sha256
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Field

from safestage_eval._text.json_text import from_json
from safestage_eval.episode import Episode, Header, Record
from safestage_eval.errors import TraceError
from safestage_eval.formats.header_limits import check_counts, check_texts, validated
from safestage_eval.formats.parquet.dataset_layout import check_version
from safestage_eval.formats.parquet.episode_row import encode

TRACK_COLUMNS = ("position", "orientation", "linear_velocity", "angular_velocity")


def _parse(value: Any) -> Any:
    try:
        return from_json(value) if isinstance(value, str) else value
    except ValueError as error:
        raise ValueError(f"Invalid JSON: {error}") from None


_JSON = BeforeValidator(_parse)


class McapMetadata(Record):
    """Texts of the record ``safestage``, most of them JSON."""

    schema_version: str
    header: Annotated[Header, _JSON]
    moving: Annotated[tuple[str, ...] | None, _JSON] = None
    """Bodies in each frame, in order; all movable ones when absent."""
    fixed: Annotated[
        dict[str, Annotated[tuple[float, ...], Field(min_length=13, max_length=13)]], _JSON
    ] = Field(default_factory=dict)
    """Body → position, orientation, linear and angular velocity of those that never move."""
    channels: Annotated[tuple[tuple[str, str], ...], _JSON] = ()
    """(body, name) of the values in a frame's ``channel``."""
    frames: int | None = None
    content_hash: str | None = None
    checksum: str | None = None
    """SHA-256 of the other texts: chunks have their own."""

    @property
    def moving_bodies(self) -> tuple[str, ...]:
        """The bodies in each frame, in order."""
        if self.moving is not None:
            return self.moving
        return tuple(body.name for body in self.header.bodies if body.movable)


def from_texts(texts: Mapping[str, str], where: str) -> McapMetadata:
    """Read the record. Raises TraceError for a newer major version or what does not fit."""
    check_version(texts.get("schema_version", ""), where)
    if texts.get("checksum", checksum(texts)) != checksum(texts):
        raise TraceError(
            f"{where}, metadata",
            "the header does not match its checksum.",
            fix="copy the file again, or record the episode again",
        )
    check_texts(texts, f"{where}, metadata")
    metadata = validated(McapMetadata, dict(texts), f"{where}, metadata")
    check_counts(metadata.header, where)
    return metadata


def to_texts(episode: Episode, moving: list[str]) -> dict[str, str]:
    """Return the record of an episode. Raises TraceError for numbers that are not finite."""
    header, where = episode.header, episode.header.episode_id
    fixed = {
        name: np.concatenate([getattr(track, c)[0] for c in TRACK_COLUMNS]).tolist()
        for name, track in episode.tracks.items()
        if name not in moving
    }
    texts = {
        "schema_version": header.schema_version,
        "header": encode(header.model_dump(mode="json"), where),
        "moving": encode(moving, where),
        "fixed": encode(fixed, where),
        "channels": encode([list(key) for key in episode.channels], where),
        "frames": str(len(episode)),
        "content_hash": episode.content_hash,
    }
    return texts | {"checksum": checksum(texts)}


def checksum(texts: Mapping[str, str]) -> str:
    """Return the SHA-256 (hex) of all texts but the checksum itself."""
    items = sorted((name, text) for name, text in texts.items() if name != "checksum")
    return sha256(json.dumps(items).encode()).hexdigest()
