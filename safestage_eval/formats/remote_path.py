"""A place in an object store, ``s3://bucket/key``, that is joined, listed and read like a path."""

from __future__ import annotations

import io
import os
import re
import threading
import time
from collections.abc import Generator, Hashable, Iterator
from dataclasses import dataclass
from datetime import timedelta
from fnmatch import fnmatchcase
from functools import lru_cache
from pathlib import Path, PosixPath
from types import SimpleNamespace
from typing import IO, Any, TypeVar

from safestage_eval.errors import InputError

from .byte_source import BlockSource, SourceStream

T = TypeVar("T")

TRIES, PAUSE = 5, 0.2
"""Times that a store is asked, and s between the first two; each pause is twice as long."""

ANSWER = 120.0
"""s that an answer may take; a store that does not answer by then is not asked again."""

FRESH = 60.0
"""s for which what a store said of an object holds in a process; whoever looks for episodes asks anew."""

_HELD = 16
"""Objects that are held open: those of two episodes or so."""

_STREAM = 1 << 20
"""Bytes that are read at once of an object that is read from its beginning on."""

_URI = re.compile(r"([a-z][a-z0-9+.-]+):/{1,2}(.*)", re.DOTALL)


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
    """A path whose files are in a store. Stores are asked again when they fail, then it is an OSError.

    ``s3://`` and ``gs://`` go through ``pyarrow.fs``, ``hf://`` and all others through fsspec.
    Credentials, region and endpoint (``AWS_ENDPOINT_URL``, ``STORAGE_EMULATOR_HOST``) are those of the
    environment.
    """

    def __str__(self) -> str:
        """With both slashes, which paths make one of."""
        scheme, rest = self._split()
        return f"{scheme}://{rest}"

    def __fspath__(self) -> str:
        return str(self)

    def _split(self) -> tuple[str, str]:
        match = _URI.fullmatch(super().__str__())
        assert match is not None
        return match[1], match[2]

    def _info(self) -> Any:
        scheme, place = self._split()
        return tried(lambda: filesystem(scheme).get_file_info(place))

    def exists(self, **_: Any) -> bool:
        """True if there is an object, or any below it."""
        if self.parent.name == "assets":
            return self.name in _assets(self.parent)
        return bool(self._info().type.value >= _FILE)

    def is_file(self, **_: Any) -> bool:
        """True if there is an object."""
        return _held(self) is not None or bool(self._info().type.value == _FILE)

    def is_dir(self, **_: Any) -> bool:
        """True if there are objects below it."""
        return bool(self._info().type.value == _FOLDER)

    def stat(self, **_: Any) -> Any:
        """Return its size. Raises FileNotFoundError."""
        return SimpleNamespace(st_size=_opened(self).size)

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
        infos = tried(lambda: filesystem(scheme).get_file_info(FileSelector(place, recursive=deep)))
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

    def source(self) -> BlockSource:
        """Open for reading by ranges."""
        held = _opened(self)

        def fetch(at: int, count: int) -> bytes:
            data: bytes = tried(lambda: held.file.read_at(count, at))
            if len(data) != count:
                raise OSError(5, f"{len(data)} bytes came in place of {count}", str(self))
            return data

        return BlockSource(held.size, fetch, held.state)

    def open(self, mode: str = "r", *_: Any, **__: Any) -> IO[Any]:  # type: ignore[override]
        """Open for reading bytes; raises InputError for any other mode."""
        if mode != "rb":
            raise InputError(str(self), "object stores are only read.", fix="give a local folder")
        return io.BufferedReader(SourceStream(self.source()), _STREAM)

    def read_bytes(self) -> bytes:
        """Read all of it; assets, named after their content, once per process."""
        return _asset(self) if self.parent.name == "assets" else self._whole()

    def _whole(self) -> bytes:
        source = self.source()
        return source.read(0, source.size)

    def read_text(self, encoding: str | None = None, *_: Any, **__: Any) -> str:
        """Read all of it as text."""
        return self._whole().decode(encoding or "utf-8")


_FILE, _FOLDER = 2, 3
"""Values of ``pyarrow.fs.FileType``."""


@dataclass(frozen=True)
class _Object:
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


_OBJECTS: dict[RemotePath, _Object] = {}


def forget() -> None:
    """Forget the states of objects, so that stores are asked again."""
    _OBJECTS.clear()
    _assets.cache_clear()


def _held(path: RemotePath) -> _Object | None:
    held = _OBJECTS.get(path)
    return held if held is not None and time.monotonic() - held.since < FRESH else None


def _opened(path: RemotePath) -> _Object:
    """Asked for once, unless that was long ago or many others were since. Raises OSError."""
    held = _held(path)
    if held is None:
        scheme, place = path._split()  # noqa: SLF001
        since = time.monotonic()
        file = tried(lambda: filesystem(scheme).open_input_file(place))
        size, tag = tried(file.size), (file.metadata() or {}).get("ETag")
        state = tag or path._info().mtime_ns  # noqa: SLF001
        held = _OBJECTS[path] = _Object(file, size, (state, size), since)
        while len(_OBJECTS) > _HELD:
            _OBJECTS.pop(next(iter(_OBJECTS)), None)
    return held


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
            retry_strategy=fs.AwsStandardS3RetryStrategy(max_attempts=1),  # ``tried`` does it
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


def tried(ask: Any) -> Any:
    """Call a function of a store, again when it fails. Raises the last OSError.

    TimeoutError is one, for a store that does not answer. Its client cannot be stopped and is left behind.
    """
    for attempt in range(TRIES):
        try:
            return _answered(ask)
        except (FileNotFoundError, TimeoutError):
            raise
        except OSError:
            if attempt == TRIES - 1:
                raise
            time.sleep(PAUSE * 2**attempt)
    raise AssertionError


def _answered(ask: Any) -> Any:
    """Call a function within ``ANSWER`` s. Raises what it raises, and TimeoutError."""
    answers: list[tuple[bool, Any]] = []

    def go() -> None:
        try:
            answers.append((True, ask()))
        except BaseException as error:  # noqa: BLE001 — raised again below
            answers.append((False, error))

    asking = threading.Thread(target=go, daemon=True)
    asking.start()
    asking.join(ANSWER)
    if not answers:
        raise TimeoutError(110, f"the store did not answer within {ANSWER:g} s")
    well, answer = answers[0]
    if not well:
        raise answer
    return answer
