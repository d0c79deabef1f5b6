"""Reading the ZIP files of ``safestage-record``: a JSON header and NumPy arrays, stored as they are."""

from __future__ import annotations

import io
import json
import math
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
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
    still_track,
)
from safestage_eval.errors import TraceError
from safestage_eval.size_limits import current

from .contact_points import POINT, GeomNames, contact_table
from .frame_buffers import ROBOT_COLUMNS
from .header_limits import check_counts, check_data, validated
from .parquet.dataset_layout import check_version

FORMAT = "safestage-zip"
HEADER = "safestage.json"
ZIP_MAGIC = b"PK\x03\x04"
MOST = 4 << 30
"""Bytes of a member; a recording of an hour has less."""

_WIDTHS = (("position", 3), ("orientation", 4), ("linear_velocity", 3), ("angular_velocity", 3))


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
    """Read an episode.

    Args:
        path: the file.
        checked: raise on broken invariants.

    Raises:
        TraceError: not a trace, cut off or damaged, or an invariant is broken.
    """
    where = str(path)
    with _archive(path) as archive:
        about = _about(archive, where)
        header = _header(about, where)
        moving = [body.name for body in header.bodies if body.movable]
        fixed = [body.name for body in header.bodies if not body.movable]
        t = _array(archive, "t", where, (None,), np.float64)
        frames = len(t)
        current().demand("frames", frames, where)
        if about.get("frames") != frames:
            what = f"{frames} frames, but the header says {about.get('frames')!r}."
            raise TraceError(where, what)
        motion = [_array(archive, name, where, (len(moving), frames, n)) for name, n in _WIDTHS]
        still = [
            _array(archive, f"fixed_{name}", where, (len(fixed), n)) for name, n in _WIDTHS[:2]
        ]
        robot = RobotFrames(*(_array(archive, n, where, (None, None)) for n in ROBOT_COLUMNS))
        meshes = {key: _mesh(archive, key, where) for key in header.mesh_keys}
        contacts = _contacts(archive, header, frames, where)
    tracks = {name: Track(*(values[i] for values in motion)) for i, name in enumerate(moving)}
    tracks |= {name: still_track(*(values[i] for values in still)) for i, name in enumerate(fixed)}
    episode = Episode(
        header=header,
        t=t,
        tracks={body.name: tracks[body.name] for body in header.bodies},
        _contacts=contacts,
        _frames=robot,
        meshes=meshes,
        path=path,
    )
    if checked:
        for error in check(episode):
            raise error
    return episode


def _contacts(archive: zipfile.ZipFile, header: Header, frames: int, where: str) -> ContactTable:
    points = _array(archive, "contacts", where, (None,), POINT)
    counts = _array(archive, "counts", where, (frames,), np.int64)
    if (counts < 0).any() or (counts > len(points)).any() or int(counts.sum()) != len(points):
        raise TraceError(where, f"{len(points)} contacts, but the frames count {counts.sum()}.")
    current().demand("contacts", int(counts.max(initial=0)), where)
    return contact_table(points, counts, GeomNames(header))


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
    vertices = _array(archive, f"mesh/{key}.vertices", where, (None, None))
    faces = _array(archive, f"mesh/{key}.faces", where, (None, None), np.int32)
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
    archive: zipfile.ZipFile,
    name: str,
    where: str,
    shape: tuple[int | None, ...],
    kind: Any = np.float32,
) -> NDArray[Any]:
    """An array of one type and shape, of which None stands for any number. Raises TraceError for any other."""
    data, wanted = _bytes(archive, f"{name}.npy", where), np.dtype(kind)
    content = io.BytesIO(data)
    try:
        if np.lib.format.read_magic(content) != (1, 0):
            raise ValueError("not of version 1.0")
        there, fortran, dtype = np.lib.format.read_array_header_1_0(content)
    except (ValueError, SyntaxError, TypeError, RecursionError, MemoryError, TokenError) as error:
        raise TraceError(where, f"{name}.npy cannot be read: {error}.") from None
    if dtype != wanted or len(there) != len(shape) or fortran or min(there) < 0:
        raise TraceError(
            where, f"{name}.npy has {len(there)} axes of {dtype}.", f"{len(shape)} of {wanted}"
        )
    if any(n not in (None, m) for n, m in zip(shape, there, strict=True)):
        allowed = ", ".join("any" if n is None else str(n) for n in shape)
        raise TraceError(where, f"{name}.npy has the shape {there}.", allowed)
    if len(data) - content.tell() != math.prod(there) * wanted.itemsize:
        raise TraceError(where, f"{name}.npy holds other than the {there} values that it states.")
    return np.frombuffer(data, wanted, offset=content.tell()).reshape(there)


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
