"""A place in an object store, ``s3://bucket/key``, that is joined, listed and read like a path."""

from __future__ import annotations

import io
import os
import re
import time
from collections.abc import Generator, Hashable, Iterator
from datetime import timedelta
from fnmatch import fnmatchcase
from functools import lru_cache
from pathlib import Path, PosixPath
from types import SimpleNamespace
from typing import IO, Any, NamedTuple

from safestage_eval.errors import InputError

TRIES = 5
"""Times that S3 is asked; the clients of other stores know themselves when to give up."""

FRESH = 60.0
"""s for which what a store said of an object holds in a process; whoever looks for episodes asks anew."""

_HELD = 16
"""Objects that are held open: those of two episodes or so."""

_STREAM = 1 << 20
"""Bytes that are read at once of an object that is read from its beginning on."""

_URI = re.compile(r"([a-z][a-z0-9+.-]+):/{1,2}(.*)", re.DOTALL)

_FILE, _FOLDER = 2, 3
"""Values of ``pyarrow.fs.FileType``."""


def as_path(place: str | Path) -> Path:
    """Return the path of a user's argument; with ``scheme://`` it is in a store."""
    if isinstance(place, str) and "://" in place:
        return RemotePath(place)
    return Path(place)


def walk(folder: Path) -> Iterator[tuple[Path, list[str], list[str]]]:
    """Yield each folder below one with the names of its folders and files, as ``os.walk``."""
    if not isinstance(folder, RemotePath):
        for root, folders, files in os.walk(folder):
            yield Path(root), folders, files
        return
    folders, files = folder.names()
    yield folder, folders, files
    for name in folders:
        yield from walk(folder / name)


class RemotePath(PosixPath):
    """A path whose files are in a store; what fails for good is an OSError.

    ``s3://`` and ``gs://`` go through ``pyarrow.fs``, ``hf://`` and all others through fsspec.
    Credentials, region and endpoint (``AWS_ENDPOINT_URL``, ``STORAGE_EMULATOR_HOST``) are those of the
    environment.
    """

    def __str__(self) -> str:
        """With both slashes, which paths make one of."""
        return "://".join(self._split())

    def __fspath__(self) -> str:
        return str(self)

    def _split(self) -> tuple[str, str]:
        match = _URI.fullmatch(super().__str__())
        assert match is not None
        return match[1], match[2]

    def _kind(self) -> int:
        scheme, place = self._split()
        return int(filesystem(scheme).get_file_info(place).type.value)

    def exists(self, **_: Any) -> bool:
        """True if there is an object, or any below it."""
        if self.parent.name == "assets":
            return self.name in _assets(self.parent)
        return self._kind() >= _FILE

    def is_file(self, **_: Any) -> bool:
        """True if there is an object."""
        return _fresh(self) is not None or self._kind() == _FILE

    def is_dir(self, **_: Any) -> bool:
        """True if there are objects below it."""
        return self._kind() == _FOLDER

    def stat(self, **_: Any) -> Any:
        """Return its size. Raises FileNotFoundError."""
        return SimpleNamespace(st_size=self.opened().size)

    def resolve(self, strict: bool = False) -> RemotePath:  # noqa: ARG002
        """Itself."""
        return self

    def absolute(self) -> RemotePath:
        """Itself."""
        return self

    def names(self) -> tuple[list[str], list[str]]:
        """Return the names of the folders and of the files in it."""
        from pyarrow.fs import FileSelector

        scheme, place = self._split()
        deep = scheme == "gs"  # Arrow lists folders there only if somebody made objects for them
        infos = filesystem(scheme).get_file_info(FileSelector(place, recursive=deep))
        folders = {info.base_name for info in infos if info.type.value == _FOLDER}
        files = {info.base_name for info in infos if info.type.value == _FILE}
        if deep:
            inside = [info.path[len(place.rstrip("/")) + 1 :].rstrip("/") for info in infos]
            folders = {path.partition("/")[0] for path in inside if "/" in path}
            files = {path for path, info in zip(inside, infos, strict=True)
                     if "/" not in path and info.type.value == _FILE}  # fmt: skip
        return sorted(folders), sorted(files)

    def glob(self, pattern: str, **_: Any) -> Generator[RemotePath, None, None]:
        """Yield the files in it, and not deeper, whose names match."""
        try:
            names = self.names()[1]
        except FileNotFoundError:
            return
        yield from (self / name for name in names if fnmatchcase(name, pattern))

    def opened(self) -> Opened:
        """Open it for pyarrow, once, unless that was long ago or many others were since. Raises OSError."""
        held = _fresh(self)
        if held is None:
            scheme, place = self._split()
            store, since = filesystem(scheme), time.monotonic()
            file = store.open_input_file(place)
            tag = (file.metadata() or {}).get("ETag") or store.get_file_info(place).mtime_ns
            held = _OPENED[self] = Opened(file, file.size(), (tag, file.size()), since)
            while len(_OPENED) > _HELD:
                _OPENED.pop(next(iter(_OPENED)), None)
        return held

    def open(self, mode: str = "r", *_: Any, **__: Any) -> IO[Any]:  # type: ignore[override]
        """Open for reading bytes; raises InputError for any other mode."""
        if mode != "rb":
            raise InputError(str(self), "object stores are only read.", fix="give a local folder")
        return io.BufferedReader(_Stream(self.opened()), _STREAM)

    def read_bytes(self) -> bytes:
        """Read all of it; assets, named after their content, once per process."""
        return _asset(self) if self.parent.name == "assets" else self._whole()

    def _whole(self) -> bytes:
        with self.open("rb") as stream:
            data: bytes = stream.read()
        return data

    def read_text(self, encoding: str | None = None, *_: Any, **__: Any) -> str:
        """Read all of it as text."""
        return self._whole().decode(encoding or "utf-8")


class Opened(NamedTuple):
    """An open object and what the store said of it then: to ask for its size is a request.

    Attributes:
        file: as ``pyarrow.fs`` opened it.
        size: in bytes.
        state: another one when the object is another.
        since: when it was asked for, on the monotonic clock.
    """

    file: Any
    size: int
    state: Hashable
    since: float


class _Stream(io.RawIOBase):
    """An open object, read from its beginning on; closing it leaves the object open."""

    def __init__(self, opened: Opened) -> None:
        self._opened, self._at = opened, 0

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        self._at = offset + (0, self._at, self._opened.size)[whence]
        return self._at

    def readinto(self, buffer: Any) -> int:
        count = max(0, min(len(buffer), self._opened.size - self._at))
        data = self._opened.file.read_at(count, self._at) if count else b""
        if len(data) != count:
            raise OSError(5, f"{len(data)} bytes came in place of {count}")
        buffer[:count] = data
        self._at += count
        return count


_OPENED: dict[RemotePath, Opened] = {}


def forget() -> None:
    """Forget the states of objects, so that stores are asked again."""
    _OPENED.clear()
    _assets.cache_clear()


def _fresh(path: RemotePath) -> Opened | None:
    held = _OPENED.get(path)
    return held if held is not None and time.monotonic() - held.since < FRESH else None


@lru_cache(maxsize=128)
def _asset(path: RemotePath) -> bytes:
    return path._whole()  # noqa: SLF001


@lru_cache(maxsize=8)
def _assets(folder: RemotePath) -> frozenset[str]:
    """Names of a dataset's assets, asked for once."""
    return frozenset(folder.names()[1])


_GIVE_UP = timedelta(seconds=20)
"""After which Google's client says what failed; 15 minutes if it is not told."""


@lru_cache
def filesystem(scheme: str) -> Any:
    """Return the file system of a scheme. Raises InputError for one that is not supported here."""
    from pyarrow import fs

    if scheme == "s3":
        return fs.S3FileSystem(
            endpoint_override=os.environ.get("AWS_ENDPOINT_URL"),
            region=os.environ.get("AWS_REGION") or os.environ.get("AWS_DEFAULT_REGION"),
            retry_strategy=fs.AwsStandardS3RetryStrategy(max_attempts=TRIES),
            connect_timeout=10,
            request_timeout=60,
        )
    if scheme == "gs":
        emulator = os.environ.get("STORAGE_EMULATOR_HOST", "")
        if not emulator:
            return fs.GcsFileSystem(retry_time_limit=_GIVE_UP)
        kind, _, host = emulator.rpartition("://")
        return fs.GcsFileSystem(
            anonymous=True, scheme=kind or "http", endpoint_override=host, retry_time_limit=_GIVE_UP
        )
    try:
        import fsspec  # type: ignore[import-untyped]

        return fs.PyFileSystem(fs.FSSpecHandler(fsspec.filesystem(scheme)))
    except (ImportError, ValueError) as error:
        raise InputError(
            f"{scheme}://", f"this store cannot be read: {error}.", "s3, gs, hf, and those of fsspec",
            "pip install fsspec, and for hf:// huggingface_hub",
        ) from None  # fmt: skip
