"""Messages of foreign recordings: MCAP files, ROS 1 bags (``.bag``), and ROS 2 bags in SQLite (``.db3``).

MCAP (mcap.dev/spec) is read record by record, never by its index: an index that lost a chunk loses no message here, and
a chunk is unpacked within the limits of our own files. rosbags reads bags. A database may hold views and computed columns
in the place of tables: programs, which can run for ever. Such a bag is refused before rosbags opens it.
"""

from __future__ import annotations

import json
import sqlite3
import struct
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from functools import partial
from io import BytesIO
from pathlib import Path
from time import process_time
from types import SimpleNamespace
from typing import Any, BinaryIO, NamedTuple

from safestage_eval.errors import InputError
from safestage_eval.formats.mcap.mcap_records import MAGIC, stated_size, text, unpack
from safestage_eval.size_limits import current

from .importer import SourceError

ROS1 = b"#ROSBAG V2.0\n"
SQLITE = b"SQLite format 3\0"

HEADER, SCHEMA, CHANNEL, MESSAGE, CHUNK, STATISTICS = 1, 3, 4, 5, 6, 11
FOOTER = 9 + 20
"""Bytes of the last record, before the magic."""


class Message(NamedTuple):
    """One message: its type, topic, time in ns, and what decodes it."""

    type: str
    topic: str
    time: int
    decode: Callable[[], Any]


def begins(path: Path) -> bytes:
    """``MAGIC`` (MCAP), ``ROS1``, ``SQLITE``, by which a recording begins; nothing of another file."""
    try:
        with path.open("rb") as stream:
            head = stream.read(len(SQLITE))
    except OSError:
        return b""
    return next((magic for magic in (MAGIC, ROS1, SQLITE) if head.startswith(magic)), b"")


def topics(path: Path) -> dict[str, str]:
    """Topic → type of its messages, at a glance; nothing of our own files, damaged ones and others.

    Raises:
        SourceError: rosbags is not installed.
    """
    try:
        if begins(path) == MAGIC:
            return _summary(path)
        with _bag(path) as bag:
            return {connection.topic: connection.msgtype for connection in bag.connections}
    except SourceError:
        raise
    except Exception:  # noqa: BLE001 — the readers of others fail in many ways on damaged bytes
        return {}


def messages(path: Path) -> Iterator[Message]:
    """Yield all messages of a file, in its order.

    Raises:
        SourceError: a library is not installed, or messages are in an encoding that is not read.
        ValueError: the file is damaged, or is no recording.
    """
    try:
        yield from _of_mcap(path) if begins(path) == MAGIC else _of_bag(path)
    except (InputError, ValueError):
        raise
    except Exception as error:  # noqa: BLE001 — as above
        raise ValueError(str(error) or type(error).__name__) from None


# ---- MCAP


def _records(stream: BinaryIO, end: int) -> Iterator[tuple[int, bytes]]:
    """Opcode and content of each record up to a byte."""
    while (at := stream.tell()) < end:
        prefix = stream.read(9)
        length = int.from_bytes(prefix[1:], "little")
        if len(prefix) < 9 or at + 9 + length > end:
            raise ValueError(f"the record at byte {at} is cut off")
        yield prefix[0], stream.read(length)


class _Channels:
    """The schemas and channels that records declare."""

    def __init__(self) -> None:
        self.schemas: dict[int, Any] = {}
        self.channels: dict[int, tuple[str, str, Any]] = {}

    def take(self, kind: int, content: bytes) -> None:
        if kind == SCHEMA:
            from mcap.records import Schema

            number = int.from_bytes(content[:2], "little")
            name, at = text(content, 2)
            encoding, at = text(content, at)
            self.schemas[number] = Schema(
                id=number, name=name, encoding=encoding, data=content[at + 4 :]
            )
        elif kind == CHANNEL:
            number, schema = struct.unpack_from("<HH", content)
            topic, at = text(content, 4)
            self.channels[number] = topic, text(content, at)[0], self.schemas.get(schema)


def _summary(path: Path) -> dict[str, str]:
    size, found = path.stat().st_size, _Channels()
    with path.open("rb") as stream:
        stream.seek(len(MAGIC))
        kind, head = next(_records(stream, size))
        if kind != HEADER or text(head, 0)[0] == "safestage":
            return {}
        stream.seek(size - len(MAGIC) - FOOTER)
        begin = int.from_bytes(stream.read(FOOTER)[9:17], "little")
        stream.seek(begin or size)
        for kind, content in _records(stream, size - len(MAGIC)):
            found.take(kind, content)
    return {topic: schema.name if schema else "-" for topic, _, schema in found.channels.values()}


def _of_mcap(path: Path) -> Iterator[Message]:
    found, decoders = _Channels(), dict[int, Callable[[bytes], Any]]()
    size, count, stated, decoded = path.stat().st_size, 0, None, 0

    def decode(channel: int, data: bytes) -> Any:
        if channel not in decoders:
            _, encoding, schema = found.channels[channel]
            decoders[channel] = _mcap_decoder(encoding, schema, path)
        return decoders[channel](data)

    with path.open("rb") as stream:
        stream.seek(size - len(MAGIC))
        if stream.read() != MAGIC:
            raise ValueError("it is cut off")
        stream.seek(len(MAGIC))
        for kind, content in _records(stream, size - len(MAGIC)):
            inner = iter([(kind, content)])
            if kind == CHUNK:
                decoded += stated_size(content)
                current().demand_decoded(decoded, size, str(path))
                block = unpack(content)
                inner = _records(BytesIO(block), len(block))
            for what, data in inner:
                found.take(what, data)
                if what == STATISTICS:
                    stated = int.from_bytes(data[:8], "little")
                elif what == MESSAGE:
                    channel, _, time = struct.unpack_from("<HIQ", data)
                    if channel not in found.channels:
                        raise ValueError(
                            f"messages of a channel {channel}, which is nowhere declared"
                        )
                    topic, _, schema = found.channels[channel]
                    count += 1
                    yield Message(
                        schema.name if schema else "", topic, time,
                        partial(decode, channel, data[22:]),
                    )  # fmt: skip
    if stated is not None and stated != count:
        raise ValueError(f"it says that it has {stated:,} messages, and has {count:,}")


def _mcap_decoder(encoding: str, schema: Any, path: Path) -> Callable[[bytes], Any]:
    if encoding == "json":
        return _from_json
    factory: Any
    if encoding == "protobuf":
        from mcap_protobuf.decoder import DecoderFactory

        factory = DecoderFactory()
    elif encoding == "cdr":
        try:
            from mcap_ros2.decoder import DecoderFactory as RosDecoderFactory
        except ImportError:
            raise SourceError(
                str(path), "ROS 2 messages need a package.", fix="pip install 'safestage[import]'"
            ) from None
        factory = RosDecoderFactory()
    else:
        raise SourceError(
            str(path), f"messages of {schema.name} in the encoding {encoding!r}.",
            "cdr (ROS 2), protobuf, json", "convert the recording, e.g. with `rosbags-convert`",
        )  # fmt: skip
    decode = factory.decoder_for(encoding, schema)
    if decode is None:
        raise SourceError(
            str(path), f"the schema of {schema.name} is written as {schema.encoding!r}.",
            "ros2msg, protobuf, jsonschema",
        )  # fmt: skip
    return decode  # type: ignore[no-any-return]


def _from_json(data: bytes) -> Any:
    if b"\\ud" in data.lower():  # half of a pair of UTF-16 is no name that could be written
        json.dumps(json.loads(data), ensure_ascii=False).encode()
    return json.loads(data, object_hook=lambda d: SimpleNamespace(**d))


# ---- bags of ROS


def _of_bag(path: Path) -> Iterator[Message]:
    end = process_time() + current().seconds
    with _bag(path, whole=True) as bag:
        decode = _ros_decoder(bag, path)
        for connection, time, data in bag.messages(bag.connections) if bag.connections else ():
            if process_time() > end:
                raise ValueError(f"reading it takes longer than {current().seconds:g} s")
            if not isinstance(time, int) or not isinstance(data, bytes):
                raise ValueError("a message whose time is no integer, or whose data are no bytes")
            kind = connection.msgtype
            yield Message(kind, connection.topic, time, partial(decode, data, kind))


def _ros_decoder(bag: Any, path: Path) -> Callable[[bytes, str], Any]:
    """What decodes a message of a type: by the bag's definitions in ROS 1, by those of Humble in ROS 2."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    if begins(path) == ROS1:
        store = get_typestore(Stores.EMPTY)
        types: dict[str, Any] = {}
        for connection in bag.connections:
            types.update(get_types_from_msg(connection.msgdef.data, connection.msgtype))
        store.register(types)
        return store.deserialize_ros1
    for connection in bag.connections:
        form = connection.ext.serialization_format
        if form != "cdr":
            raise SourceError(
                str(path), f"messages of {connection.msgtype} in the encoding {form!r}.", "cdr"
            )
    return get_typestore(Stores.ROS2_HUMBLE).deserialize_cdr


@contextmanager
def _bag(path: Path, *, whole: bool = False) -> Iterator[Any]:
    """Open one file; with ``whole`` a database is looked through for damage first."""
    try:
        from rosbags.rosbag1 import Reader as Ros1
        from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader
    except ImportError:
        raise SourceError(
            str(path), "is a ROS bag, which rosbags reads.", fix="pip install 'safestage[import]'"
        ) from None
    if begins(path) == ROS1:
        reader: Any = Ros1(path)
    else:
        _demand_tables(path, whole=whole)
        reader = Sqlite3Reader(path.absolute())
    reader.open()
    with closing(reader):
        yield reader


def _demand_tables(path: Path, *, whole: bool) -> None:
    """Raise ValueError unless what rosbags asks for are stored tables without computed columns."""
    uri = f"{path.absolute().as_uri()}?mode=ro&immutable=1"
    try:
        with closing(sqlite3.connect(uri, uri=True)) as bag:
            for name in ("topics", "messages", "schema", "message_definitions", "metadata"):
                table = bag.execute(_TABLE, (name,)).fetchone()
                if table is None and name in ("topics", "messages"):
                    raise ValueError(f"the database is no ROS 2 bag: it has no table {name!r}")
                if table is not None and table != ("table", 1, 0):
                    raise ValueError(f"the database is no ROS 2 bag: {name!r} is no plain table")
            for query, sound, problem in _SOUND if whole else ():
                answer = bag.execute(query).fetchone()
                if answer != sound:
                    raise ValueError(f"{problem}: {answer and answer[0]}")
    except sqlite3.Error as error:
        raise ValueError(f"the database cannot be read: {error}") from None


_SOUND = (
    ("PRAGMA quick_check(1)", ("ok",), "the database is damaged"),
    ("SELECT topic_id FROM messages WHERE topic_id NOT IN (SELECT id FROM topics) LIMIT 1", None,
     "a message of a topic which the bag does not list"),
    ("SELECT typeof(timestamp) FROM messages WHERE typeof(timestamp) != 'integer' LIMIT 1", None,
     "a message whose time is no integer"),
)  # fmt: skip
"""Query, its answer in a sound bag, and what another answer means. rosbags asks none of them."""

_TABLE = """SELECT type, rootpage > 0, (SELECT count(*) FROM pragma_table_xinfo(?1) WHERE hidden > 0)
FROM sqlite_master WHERE lower(name) = ?1"""
"""Query: the type of a name's entry, whether it is stored, and how many columns are computed."""
