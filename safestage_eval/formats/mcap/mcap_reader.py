"""Reading an episode from an MCAP file."""

from __future__ import annotations

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
    check_frames,
    check_header,
    check_time,
    check_track,
    sound_motion,
)
from safestage_eval.errors import TraceError
from safestage_eval.formats.contact_points import GeomNames, contact_table
from safestage_eval.formats.ply import from_ply
from safestage_eval.size_limits import current

from .mcap_frames import ROBOT_FIELDS, cloud_points, frame_columns, full_states
from .mcap_messages import CONTACTS, FRAME, PROFILE, STATE
from .mcap_metadata import TRACK_COLUMNS, McapMetadata, from_texts
from .mcap_records import McapRecords, read_records

_WIDTHS = dict(zip(TRACK_COLUMNS, (3, 4, 3, 3), strict=True))
"""Column of a track → numbers per body in a frame's ``body_<column>``."""


def read_header(path: Path) -> tuple[Header, dict[str, Any]]:
    """Return the header, and length and content hash as stated; reads only the beginning of the file.

    Raises:
        TraceError: not a trace, cut off before the header ends, or of a newer major version.
    """
    metadata = _metadata(read_records(path, (), until=PROFILE), str(path))
    stated = {"length": metadata.frames, "content_hash": metadata.content_hash}
    return metadata.header, stated


def _metadata(records: McapRecords, where: str) -> McapMetadata:
    texts = records.metadata.get(PROFILE)
    if texts is None and not records.whole:
        raise _cut_off(records, 0, where)
    if texts is None:
        raise TraceError(
            where,
            f"an MCAP file of profile {records.profile!r} without the metadata record "
            f"{PROFILE!r}: no trace.",
            f"profile {PROFILE!r}",
            "if it has transforms, import it first: safestage import FILE --to DATASET",
        )
    return from_texts(texts, where)


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
    records = read_records(path, (FRAME, CONTACTS, STATE))
    metadata = _metadata(records, where)
    header = metadata.header
    count, clouds = records.count(FRAME), records.count(CONTACTS)
    if not records.whole:
        count = min(count, clouds)
        if not recover or not count:
            raise _cut_off(records, count, where)
        note = f"recovered from a file cut off at byte {records.size}: {count} frames"
        notes = (*header.notes, note)
        header = header.model_copy(update={"notes": notes, "termination": "truncated"})
    elif metadata.frames not in (None, count):
        raise TraceError(where, f"{count} frames, but the header says {metadata.frames}")
    elif clouds not in (0, count):
        what = f"{clouds} messages on {CONTACTS} for {count} frames."
        raise TraceError(where, what, "one per frame, or none at all")
    current().demand("frames", count, where)
    columns = frame_columns(records.messages[FRAME], count, where)
    if not np.array_equal(columns["frame_index"][:, 0], np.arange(count)):
        raise TraceError(where, f"the messages on {FRAME} are not the frames 0, 1, 2, … in order")
    if columns["channel"].shape[1] != len(metadata.channels):
        there = f"{columns['channel'].shape[1]} channels in a frame"
        raise TraceError(where, f"{there}, {len(metadata.channels)} in the header")
    meshes = {}
    for key in header.mesh_keys:
        ply = records.attachments.pop(name := f"geometry/{key}.ply", None)
        if ply is not None:
            meshes[key] = from_ply(ply, key, where)
        elif checked:
            raise TraceError(where, f"the mesh {key[:12]}… is missing.", f"an attachment {name}")
    episode = Episode(
        header=header,
        t=np.ascontiguousarray(columns["time"][:, 0]),
        tracks=_tracks(metadata, columns, where),
        _contacts=_contacts(records, header, count, checked, where),
        _frames=RobotFrames(*(columns[name] for name in ROBOT_FIELDS)),
        meshes=meshes,
        channels={key: columns["channel"][:, i] for i, key in enumerate(metadata.channels)},
        states=full_states(records.messages[STATE], count, where),
        attachments=records.attachments,
        path=path,
    )
    if checked:
        _check(episode, metadata, columns)
    return episode


def _contacts(
    records: McapRecords, header: Header, frames: int, checked: bool, where: str
) -> ContactTable:
    points, counts = cloud_points(records.messages[CONTACTS], frames, where)
    current().demand("contacts", int(counts.max(initial=0)), where)
    names = GeomNames(header)
    contacts = contact_table(points, counts if len(counts) else np.zeros(frames, np.int64), names)
    for error in check_contacts(contacts, names.owner, frames, where) if checked else ():
        raise error
    return contacts


def _check(episode: Episode, metadata: McapMetadata, columns: dict[str, NDArray[Any]]) -> None:
    """Raise on a broken invariant; of bodies in the frames the columns are looked at whole first."""
    header, where = episode.header, str(episode.path)
    errors = [*check_header(header, where), *check_time(episode.t, where)]
    sound = sound_motion(*(columns[f"body_{name}"] for name in TRACK_COLUMNS))
    for body in header.bodies:
        if not sound or body.name in metadata.fixed:
            errors += check_track(episode.tracks[body.name], body.name, len(episode), where)
    errors += check_frames(episode.frames, len(episode), where)
    if errors:
        raise errors[0]


def _tracks(
    metadata: McapMetadata, columns: dict[str, NDArray[Any]], where: str
) -> dict[str, Track]:
    moving = metadata.moving_bodies
    by_body = []
    for name, width in _WIDTHS.items():
        block = columns[f"body_{name}"]
        if block.shape[1] != width * len(moving):
            what = f"body_{name} has {block.shape[1]} values for {len(moving)} moving bodies."
            raise TraceError(where, what, f"{width} per body")
        items = block.view(f"V{4 * width}").T  # each copied as one item
        by_body.append(np.ascontiguousarray(items).view(np.float32).reshape(*items.shape, width))
    tracks = {body: Track(*(values[i] for values in by_body)) for i, body in enumerate(moving)}
    for body, values in metadata.fixed.items():
        row = np.array(values, np.float32).reshape(1, 13)
        tracks[body] = Track(row[:, :3], row[:, 3:7], row[:, 7:10], row[:, 10:])
    for record in metadata.header.bodies:
        if record.name not in tracks:
            what = f"body {record.name!r} is neither in `moving` nor in `fixed`: it has no poses"
            raise TraceError(where, what)
    return {record.name: tracks[record.name] for record in metadata.header.bodies}


def _cut_off(records: McapRecords, frames: int, where: str) -> TraceError:
    return TraceError(
        where,
        f"the file ends at byte {records.size}, before its footer: {frames} whole frames.",
        fix="copy the file again, or take those frames: safestage convert FILE --recover --to mcap "
        "--out OTHER; in Python, load(path, recover=True)"
        if frames
        else "copy the file again, or record the episode again",
    )
