"""Reading an episode from an MCAP file."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import (
    ContactTable,
    Episode,
    Header,
    RobotFrames,
    Track,
    check_contacts,
    check_finite,
    check_frames,
    check_header,
    check_time,
    check_track,
)
from safestage_eval.errors import TraceError
from safestage_eval.formats.contact_points import GeomNames, PackedContacts, contact_table
from safestage_eval.formats.lazy_columns import StoredTrack
from safestage_eval.formats.ply import from_ply
from safestage_eval.size_limits import current

from .mcap_arrays import Batch
from .mcap_clouds import CloudPoints
from .mcap_frames import ROBOT_FIELDS, FrameRows, are_sound
from .mcap_messages import CONTACTS, FRAME, PROFILE, STATE, message_class
from .mcap_metadata import McapMetadata, from_texts
from .mcap_records import (
    CHUNK,
    FOOTER,
    HEADER,
    MAGIC,
    METADATA,
    McapRecords,
    damaged,
    no_mcap,
    read_metadata,
    walk,
)

_TRACK_FIELDS = {"position": 3, "orientation": 4, "linear_velocity": 3, "angular_velocity": 3}
"""Column of a track → numbers per body in a frame's ``body_<column>``."""


def read_header(path: Path) -> tuple[Header, dict[str, Any]]:
    """Return the header, and length and content hash as stated; reads only the beginning of the file.

    Raises:
        TraceError: not a trace, cut off before the header ends, or of a newer major version.
    """
    where = str(path)
    with path.open("rb") as stream:
        if stream.read(len(MAGIC)) != MAGIC:
            raise no_mcap(path, where)
        profile = ""
        while len(prefix := stream.read(9)) == 9:
            at = stream.tell() - 9
            kind, size = prefix[0], int.from_bytes(prefix[1:], "little")
            if at + 9 + size > path.stat().st_size:
                break  # cut off, or a damaged length
            if kind in (CHUNK, FOOTER):
                raise _no_trace(where, profile)
            content = stream.read(size) if kind in (HEADER, METADATA) else b""
            if kind == HEADER and len(content) == size:
                profile = content[4 : 4 + int.from_bytes(content[:4], "little")].decode(
                    "utf-8", "replace"
                )
            elif kind == METADATA and len(content) == size:
                try:
                    name, texts = read_metadata(content)
                except (IndexError, ValueError) as error:
                    raise damaged(where, at, error) from None
                if name == PROFILE:
                    metadata = from_texts(texts, where)
                    stated = {"length": metadata.frames, "content_hash": metadata.content_hash}
                    return metadata.header, stated
            elif not content:
                stream.seek(size, 1)
    raise TraceError(
        where,
        f"the file ends at byte {path.stat().st_size}, before its header: 0 whole frames.",
        fix="copy the file again, or record the episode again",
    )


def read_mcap(path: Path, *, recover: bool = False, checked: bool = True) -> Episode:
    """Read the episode in an MCAP file at once.

    Args:
        path: the file.
        recover: of a file that was cut off, take the frames that are whole. The header then says
            so in its notes, and ``termination`` is ``truncated``.
        checked: raise on broken invariants.

    Raises:
        TraceError: not a trace, cut off, damaged, or an invariant is broken.
    """
    where = str(path)
    rows, clouds, states = FrameRows(where), CloudPoints(where), _States()
    sinks = {FRAME: rows.take, CONTACTS: clouds.take, STATE: states.take}
    records = walk(path, sinks, where)
    texts = records.metadata.get(PROFILE)
    if texts is None:
        if not records.whole:
            raise _cut_off(records, 0, where)
        raise _no_trace(where, records.profile)
    metadata = from_texts(texts, where)
    count = rows.count
    if not records.whole:
        count = min(rows.count, clouds.count)
        if not recover or not count:
            raise _cut_off(records, count, where)
        note = f"recovered from a file cut off at byte {records.size}: {count} frames"
        notes = (*metadata.header.notes, note)
        header = metadata.header.model_copy(update={"notes": notes, "termination": "truncated"})
        metadata = metadata.model_copy(update={"header": header})
    elif metadata.frames not in (None, count):
        raise TraceError(where, f"{count} frames, but the header says {metadata.frames}")
    elif clouds.count not in (0, count):
        raise TraceError(
            where,
            f"{clouds.count} messages on {CONTACTS} for {count} frames.",
            "one per frame, or none at all",
        )
    current().demand("frames", count, where)
    columns = rows.columns(count)
    if not np.array_equal(columns["frame_index"][:, 0], np.arange(count)):
        raise TraceError(where, f"the messages on {FRAME} are not the frames 0, 1, 2, … in order")
    points, counts = clouds.points(min(count, clouds.count))
    current().demand("contacts", int(counts.max(initial=0)), where)
    if not clouds.count:
        counts = np.zeros(count, np.int64)
    full = states.first(count, where)
    names = GeomNames(metadata.header)
    episode = _episode(
        path, metadata, records, columns, full, checked,
        lambda: read_contacts(points, counts, names, where, checked=checked),
    )  # fmt: skip
    if checked:
        _check(episode, metadata, are_sound(columns))
    return episode


def _episode(
    path: Path,
    metadata: McapMetadata,
    records: McapRecords,
    columns: dict[str, NDArray[Any]],
    states: dict[int, NDArray[np.float64]],
    checked: bool,
    contacts: Callable[[], ContactTable],
) -> Episode:
    where, header = str(path), metadata.header
    meshes = {}
    for key in header.mesh_keys:
        ply = records.attachments.pop(f"geometry/{key}.ply", None)
        if ply is not None:
            meshes[key] = from_ply(ply, key, where)
        elif checked:
            raise TraceError(
                where, f"the mesh {key[:12]}… is missing.", f"an attachment geometry/{key}.ply"
            )
    tracks = _tracks(metadata, columns, where)
    robot = RobotFrames(*(columns[name] for name in ROBOT_FIELDS))
    keys = metadata.channels
    if columns["channel"].shape[1] != len(keys):
        raise TraceError(
            where, f"{columns['channel'].shape[1]} channels in a frame, {len(keys)} in the header"
        )
    channels = {key: columns["channel"][:, i] for i, key in enumerate(keys)}
    return Episode(
        header=header,
        t=np.ascontiguousarray(columns["time"][:, 0]),
        tracks=tracks,
        _contacts=contacts,
        _frames=robot,
        meshes=meshes,
        channels=channels,
        states=states,
        attachments=records.attachments,
        path=path,
    )


def read_contacts(
    points: NDArray[Any],
    counts: NDArray[np.int64],
    names: GeomNames,
    where: str,
    *,
    checked: bool,
) -> ContactTable:
    """Make the canonical table of contacts.

    Args:
        points: (C,) POINT of consecutive frames.
        counts: (T,) contacts per frame.
        names: the geoms of the episode.
        where: for messages.
        checked: compare with the invariants.

    Raises:
        TraceError: a geom index that no body has, or values that are not finite.
    """
    contacts = contact_table(points, counts, names)
    with np.errstate(all="ignore"):  # geoms are summed too: they hardly ever look like no number
        finite = np.isfinite(points.view(np.float32).sum())
    if checked and not (finite and isinstance(contacts, PackedContacts)):
        for error in check_contacts(contacts, names.owner, len(counts), where):
            raise error
    return contacts


def _check(episode: Episode, metadata: McapMetadata, sound: bool) -> None:
    """Raise on a broken invariant; ``sound``: poses and twists in the frames are not among them."""
    header, where = episode.header, str(episode.path)
    errors = [*check_header(header, where), *check_time(episode.t, where)]
    for body in header.bodies:
        if not sound or body.name in metadata.fixed:
            errors += check_track(episode.tracks[body.name], body.name, len(episode), where)
    errors += check_frames(episode.frames, len(episode), where)
    for (body_name, name), values in episode.channels.items():
        errors += check_finite(values, f"channel {name!r} of {body_name!r}", where)
    if errors:
        raise errors[0]


def _tracks(
    metadata: McapMetadata, columns: dict[str, NDArray[Any]], where: str
) -> dict[str, Track]:
    moving = metadata.moving_bodies
    for name, width in _TRACK_FIELDS.items():
        block = columns[f"body_{name}"]
        if block.shape[1] != width * len(moving):
            raise TraceError(
                where,
                f"body_{name} has {block.shape[1]} values for {len(moving)} moving bodies.",
                f"{width} per body",
            )

    def columns_of(place: int, names: tuple[str, ...]) -> dict[str, NDArray[Any]]:
        parts = {}
        for name in names:
            width = _TRACK_FIELDS[name]
            items = columns[f"body_{name}"].view(f"V{4 * width}")[:, place]  # copied as one item
            parts[name] = np.ascontiguousarray(items).view(np.float32).reshape(-1, width)
        return parts

    tracks: dict[str, Track] = {
        body: StoredTrack(partial(columns_of, i)) for i, body in enumerate(moving)
    }
    for body, values in metadata.fixed.items():
        row = np.array(values, np.float32).reshape(1, 13)
        tracks[body] = Track(row[:, :3], row[:, 3:7], row[:, 7:10], row[:, 10:])
    for record in metadata.header.bodies:
        if record.name not in tracks:
            raise TraceError(
                where,
                f"body {record.name!r} is neither in `moving` nor in `fixed`: it has no poses",
            )
    return {record.name: tracks[record.name] for record in metadata.header.bodies}


class _States:
    """Collects the messages with full states."""

    def __init__(self) -> None:
        self._messages: list[bytes] = []

    def take(self, batch: Batch) -> None:
        self._messages += batch.messages()

    def first(self, frames: int, where: str) -> dict[int, NDArray[np.float64]]:
        """Return frame → state of the first frames. Raises TraceError for a message that is damaged."""
        from google.protobuf.message import DecodeError

        by_frame = {}
        for message in self._messages:
            try:
                state = message_class("State").FromString(message)
            except DecodeError as error:
                raise TraceError(where, f"a state cannot be read: {error}.") from None
            if state.frame_index < frames:
                by_frame[int(state.frame_index)] = np.array(state.state, np.float64)
        return by_frame


def _no_trace(where: str, profile: str) -> TraceError:
    return TraceError(
        where,
        f"an MCAP file of profile {profile!r} without the metadata record {PROFILE!r}: no trace.",
        f"profile {PROFILE!r}",
        "if it has transforms, import it first: safestage import FILE --to DATASET",
    )


def _cut_off(records: McapRecords, frames: int, where: str) -> TraceError:
    return TraceError(
        where,
        f"the file ends at byte {records.size}, before its footer: {frames} whole frames.",
        fix="copy the file again, or take those frames: safestage convert FILE --recover --to mcap "
        "--out OTHER; in Python, load(path, recover=True)"
        if frames
        else "copy the file again, or record the episode again",
    )
