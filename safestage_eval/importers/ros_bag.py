"""Messages of ROS 1 bags (``.bag``) and of ROS 2 bags in SQLite (``.db3``), as rosbags reads them.

A database may hold views and computed columns in the place of tables: programs, which can run for ever or return
any amount of data. Such a bag is refused before rosbags opens it.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path
from time import process_time
from typing import Any

from safestage_eval.errors import InputError
from safestage_eval.size_limits import current

from .importer import SourceError

ROS1 = b"#ROSBAG V2.0\n"
SQLITE = b"SQLite format 3\0"

Message = tuple[str, str, int, Callable[[], Any]]
"""Type, topic, time in ns, and what decodes it."""


def is_bag(path: Path) -> bool:
    """By its first bytes."""
    try:
        with path.open("rb") as stream:
            return stream.read(len(SQLITE)).startswith((ROS1, SQLITE))
    except OSError:
        return False


def types(path: Path) -> set[str]:
    """Types of the messages of a bag; none of a damaged one.

    Raises:
        SourceError: rosbags is not installed.
    """
    try:
        with _opened(path) as bag:
            return {connection.msgtype for connection in bag.connections}
    except SourceError:
        raise
    except Exception:  # noqa: BLE001 — its readers fail in many ways on damaged bytes
        return set()


def bag_messages(path: Path) -> Iterator[Message]:
    """Yield all messages of a bag by their times.

    Raises:
        SourceError: rosbags is not installed, or messages are not written as ROS does.
        ValueError: the bag is damaged, or is none.
    """
    try:
        yield from _messages(path)
    except (InputError, ValueError):
        raise
    except Exception as error:  # noqa: BLE001 — as above
        raise ValueError(str(error) or type(error).__name__) from None


def _messages(path: Path) -> Iterator[Message]:
    end = process_time() + current().seconds
    with _opened(path, whole=True) as bag:
        decode = _decoder(bag, path)
        for connection, time, data in bag.messages(bag.connections) if bag.connections else ():
            kind = connection.msgtype
            if process_time() > end:
                raise ValueError(f"reading it takes longer than {current().seconds:g} s")
            if not isinstance(time, int) or not isinstance(data, bytes):
                raise ValueError("a message whose time is no integer, or whose data are no bytes")
            yield kind, connection.topic, time, partial(decode, data, kind)


def _decoder(bag: Any, path: Path) -> Callable[[bytes, str], Any]:
    """What decodes a message of a type: by the bag's definitions in ROS 1, by those of Humble in ROS 2."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    if _is_ros1(path):
        store = get_typestore(Stores.EMPTY)
        types_: dict[str, Any] = {}
        for connection in bag.connections:
            types_.update(get_types_from_msg(connection.msgdef.data, connection.msgtype))
        store.register(types_)
        return store.deserialize_ros1
    for connection in bag.connections:
        form = connection.ext.serialization_format
        if form != "cdr":
            raise SourceError(
                str(path), f"messages of {connection.msgtype} in the encoding {form!r}.", "cdr"
            )
    return get_typestore(Stores.ROS2_HUMBLE).deserialize_cdr


@contextmanager
def _opened(path: Path, *, whole: bool = False) -> Iterator[Any]:
    """Open one file; with ``whole`` a database is looked through for damage first."""
    try:
        from rosbags.rosbag1 import Reader as Ros1
        from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader
    except ImportError:
        raise SourceError(
            str(path), "is a ROS bag, which rosbags reads.", fix="pip install 'safestage[import]'"
        ) from None
    if _is_ros1(path):
        reader: Any = Ros1(path)
    else:
        _demand_tables(path, whole=whole)
        reader = Sqlite3Reader(path.absolute())
    reader.open()
    with closing(reader):
        yield reader


def _is_ros1(path: Path) -> bool:
    with path.open("rb") as stream:
        return stream.read(len(ROS1)) == ROS1


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
            for query, sound, problem in SOUND if whole else ():
                answer = bag.execute(query).fetchone()
                if answer != sound:
                    raise ValueError(f"{problem}: {answer and answer[0]}")
    except sqlite3.Error as error:
        raise ValueError(f"the database cannot be read: {error}") from None


SOUND = (
    ("PRAGMA quick_check(1)", ("ok",), "the database is damaged"),
    (
        "SELECT topic_id FROM messages WHERE topic_id NOT IN (SELECT id FROM topics) LIMIT 1",
        None,
        "a message of a topic which the bag does not list",
    ),
    (
        "SELECT typeof(timestamp) FROM messages WHERE typeof(timestamp) != 'integer' LIMIT 1",
        None,
        "a message whose time is no integer",
    ),
)
"""Query, its answer in a sound bag, and what another answer means. rosbags asks none of them."""

_TABLE = """SELECT type, rootpage > 0, (SELECT count(*) FROM pragma_table_xinfo(?1) WHERE hidden > 0)
FROM sqlite_master WHERE lower(name) = ?1"""
"""Query: the type of a name's entry, whether it is stored, and how many columns are computed."""
