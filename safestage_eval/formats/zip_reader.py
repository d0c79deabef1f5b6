"""Reading the ZIP files of ``safestage-record``: a JSON header and NumPy arrays, stored as they are."""

from __future__ import annotations

import io
import json
import math
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from tokenize import TokenError
from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval._text.json_text import from_json
from safestage_eval.episode import (
    ContactTable,
    Episode,
    Header,
    Mesh,
    RobotFrames,
    Track,
    check,
    check_contacts,
)
from safestage_eval.errors import TraceError
from safestage_eval.size_limits import current

from .contact_points import POINT, GeomNames, contact_table
from .frame_buffers import ROBOT_COLUMNS
from .header_limits import check_counts, check_data, validated
from .lazy_columns import StoredTrack
from .parquet.dataset_layout import check_version

FORMAT = "safestage-zip"
HEADER = "safestage.json"
ZIP_MAGIC = b"PK\x03\x04"
MOST = 4 << 30
"""Bytes of a member; a recording of an hour has less."""

_WIDTHS = {"position": 3, "orientation": 4, "linear_velocity": 3, "angular_velocity": 3}


def is_zip_trace(beginning: bytes) -> bool:
    """Whether the first 64 bytes of a file are those of a trace: its header is the first member."""
    return beginning.startswith(ZIP_MAGIC) and beginning[30 : 30 + len(HEADER)] == HEADER.encode()


def read_zip_header(path: Path) -> tuple[Header, dict[str, Any]]:
    """Return the header, and the length as stated.

    Raises:
        TraceError: not a trace, cut off or damaged, or of a newer major version.
    """
    with _archive(path) as archive:
        about = _about(archive, str(path))
    header = _header(about, str(path))
    return header, {"length": about.get("frames"), "content_hash": None}


def read_zip(path: Path, *, checked: bool = True) -> Episode:
    """Read an episode; the motion of bodies and the contacts when they are first looked at.

    Args:
        path: the file.
        checked: raise on broken invariants, all of them at once.

    Raises:
        TraceError: not a trace, cut off or damaged, or an invariant is broken.
    """
    where = str(path)
    with _archive(path) as archive:
        about = _about(archive, where)
        header = _header(about, where)
        small = {name: _array(archive, name, where, 2) for name in ROBOT_COLUMNS}
        t = _array(archive, "t", where, 1, np.float64)
        place, turn = (_array(archive, f"fixed_{c}", where, 2) for c in ("position", "orientation"))
        meshes = {key: _mesh(archive, key, where) for key in header.mesh_keys}
    frames = len(t)
    current().demand("frames", frames, where)
    if about.get("frames") != frames:
        raise TraceError(where, f"{frames} frames, but the header says {about.get('frames')!r}.")
    episode = Episode(
        header=header,
        t=t,
        tracks=_tracks(path, header, frames, place, turn),
        _contacts=lambda: _contacts(path, header, frames),
        _frames=RobotFrames(*(small[name] for name in ROBOT_COLUMNS)),
        meshes=meshes,
        path=path,
    )
    if checked:
        for error in check(episode):
            raise error
    return episode


def _tracks(
    path: Path, header: Header, frames: int, place: NDArray[Any], turn: NDArray[Any]
) -> dict[str, Track]:
    where, tracks = str(path), dict[str, Track]()
    moving = [body.name for body in header.bodies if body.movable]
    fixed = [body.name for body in header.bodies if not body.movable]
    if place.shape != (len(fixed), 3) or turn.shape != (len(fixed), 4):
        raise TraceError(where, f"{len(place)} poses for {len(fixed)} fixed bodies.")
    loaded: dict[str, NDArray[Any]] = {}

    def columns_of(body: int, names: tuple[str, ...]) -> dict[str, NDArray[Any]]:
        """One column of all bodies is read at a time: they stand in the file as one array."""
        for name in names:
            if name not in loaded:
                with _archive(path) as archive:
                    values = _array(archive, name, where, 3)
                if values.shape != (len(moving), frames, _WIDTHS[name]):
                    raise TraceError(
                        where,
                        f"{name} has the shape {values.shape}.",
                        f"({len(moving)}, {frames}, {_WIDTHS[name]}): bodies, frames, components",
                    )
                loaded[name] = values
        return {name: loaded[name][body] for name in names}

    for i, name in enumerate(moving):
        tracks[name] = StoredTrack(partial(columns_of, i))
    for i, name in enumerate(fixed):
        still = np.zeros((1, 3), np.float32)
        tracks[name] = Track(place[i : i + 1], turn[i : i + 1], still, still)
    return {body.name: tracks[body.name] for body in header.bodies}


def _contacts(path: Path, header: Header, frames: int) -> ContactTable:
    where = str(path)
    with _archive(path) as archive:
        points = _array(archive, "contacts", where, 1, POINT)
        counts = _array(archive, "counts", where, 1, np.int64)
    if len(counts) != frames or (counts < 0).any() or (counts > len(points)).any():
        raise TraceError(where, f"counts of contacts for {len(counts)} frames of {frames}.")
    current().demand("contacts", int(counts.max(initial=0)), where)
    if int(counts.sum()) != len(points):
        raise TraceError(where, f"{len(points)} contacts, but the frames count {counts.sum()}.")
    names = GeomNames(header)
    table = contact_table(points, counts, names)
    for error in check_contacts(table, names.owner, frames, where):
        raise error
    return table


def _header(about: dict[str, Any], where: str) -> Header:
    stated = about.get("header")
    if about.get("format") != FORMAT or about.get("version") != 1 or not isinstance(stated, dict):
        raise TraceError(
            where,
            f"format {about.get('format')!r} of version {about.get('version')!r}.",
            f"{FORMAT}, version 1",
            "update safestage: the file is of a newer recorder",
        )
    check_version(str(stated.get("schema_version")), where)
    check_data(stated, f"{where}, {HEADER}")
    header = validated(Header, stated, f"{where}, {HEADER}")
    check_counts(header, where)
    return header


def _mesh(archive: zipfile.ZipFile, key: str, where: str) -> Mesh:
    """A mesh, whose key is the digest of its content."""
    vertices = _array(archive, f"mesh/{key}.vertices", where, 2)
    faces = _array(archive, f"mesh/{key}.faces", where, 2, np.int32)
    current().demand("vertices", len(vertices), where)
    try:
        mesh = Mesh.build(vertices, faces)
    except ValueError as error:
        raise TraceError(where, f"the mesh {key[:12]}… is broken: {error}.") from None
    if mesh.key != key:
        raise TraceError(where, f"the mesh {key[:12]}… is not what its name says.")
    return mesh


def _about(archive: zipfile.ZipFile, where: str) -> dict[str, Any]:
    try:
        about = from_json(_bytes(archive, HEADER, where))
        json.dumps(about, ensure_ascii=False).encode()  # no half of a character
    except (ValueError, RecursionError) as error:
        raise TraceError(where, f"{HEADER} cannot be read: {error}.") from None
    if not isinstance(about, dict):
        raise TraceError(where, f"{HEADER} is no JSON object.")
    return about


def _array(
    archive: zipfile.ZipFile, name: str, where: str, axes: int, kind: Any = np.float32
) -> NDArray[Any]:
    """An array of one type and number of axes. Raises TraceError for any other."""
    data, wanted = _bytes(archive, f"{name}.npy", where), np.dtype(kind)
    content = io.BytesIO(data)
    try:
        if np.lib.format.read_magic(content) != (1, 0):
            raise ValueError("not of version 1.0")
        shape, fortran, dtype = np.lib.format.read_array_header_1_0(content)
    except (ValueError, SyntaxError, TypeError, RecursionError, MemoryError, TokenError) as error:
        raise TraceError(where, f"{name}.npy cannot be read: {error}.") from None
    if dtype != wanted or len(shape) != axes or fortran or min(shape) < 0:
        raise TraceError(
            where, f"{name}.npy has {len(shape)} axes of {dtype}.", f"{axes} of {wanted}"
        )
    if len(data) - content.tell() != math.prod(shape) * wanted.itemsize:
        raise TraceError(where, f"{name}.npy holds other than the {shape} values that it states.")
    return np.frombuffer(data, wanted, offset=content.tell()).reshape(shape)


def _bytes(archive: zipfile.ZipFile, name: str, where: str) -> bytes:
    """The bytes of a member, compared with its CRC-32."""
    try:
        member = archive.getinfo(name)
    except KeyError:
        raise TraceError(where, f"{name} is missing.", fix="record the episode again") from None
    if member.compress_type != zipfile.ZIP_STORED or member.file_size > MOST:
        raise TraceError(where, f"{name} is compressed, or larger than {MOST} bytes.", "stored")
    try:
        return archive.read(member)
    except (zipfile.BadZipFile, EOFError, ValueError, RuntimeError, NotImplementedError) as error:
        raise TraceError(
            where, f"{name} is damaged: {error}.", fix="copy the file again, or record again"
        ) from None


@contextmanager
def _archive(path: Path) -> Iterator[zipfile.ZipFile]:
    """Open the file. Raises TraceError where it is none, or cut off."""
    with path.open("rb") as stream:
        try:
            archive = zipfile.ZipFile(stream)
        except (zipfile.BadZipFile, ValueError, NotImplementedError) as error:
            raise TraceError(
                str(path), f"not a whole ZIP file: {error}.", fix="copy the file again"
            ) from None
        with archive:
            yield archive
