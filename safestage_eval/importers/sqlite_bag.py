"""Messages of ROS 2 bags that are stored in SQLite (``.db3``), the default before ROS 2 Iron.

Layout: github.com/ros2/rosbag2, rosbag2_storage_sqlite3: ``topics`` (id, name, type, serialization_format) and
``messages`` (topic_id, timestamp in ns, data). The bag does not say what its messages look like; those that are
read here are defined below as ROS 2 has them since Foxy.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from time import process_time

from safestage_eval.size_limits import current

MAGIC = b"SQLite format 3\0"

_PARTS = {
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id",
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec",
    "geometry_msgs/TransformStamped": "std_msgs/Header header\nstring child_frame_id\n"
    "geometry_msgs/Transform transform",
    "geometry_msgs/Transform": "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation",
    "geometry_msgs/Vector3": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w",
    "tf2_msgs/TFMessage": "geometry_msgs/TransformStamped[] transforms",
    "std_msgs/String": "string data",
    "sensor_msgs/JointState": "std_msgs/Header header\nstring[] name\nfloat64[] position\n"
    "float64[] velocity\nfloat64[] effort",
}


def definition(kind: str) -> str | None:
    """The definition of a message in the text that ROS 2 writes into MCAP; None of those not read here.

    ``kind``: ``"tf2_msgs/msg/TFMessage"``.
    """
    name = kind.replace("/msg/", "/")
    if name not in _PARTS:
        return None
    parts, wanted = [_PARTS[name]], [name]
    for one in wanted:  # grows
        for line in _PARTS[one].splitlines():
            inner = line.split(" ")[0].removesuffix("[]")
            if inner in _PARTS and inner not in wanted:
                wanted.append(inner)
                parts.append(f"{'=' * 80}\nMSG: {inner}\n{_PARTS[inner]}")
    return "\n".join(parts)


def is_sqlite(path: Path) -> bool:
    """By its first bytes."""
    try:
        with path.open("rb") as stream:
            return stream.read(len(MAGIC)) == MAGIC
    except OSError:
        return False


def types(path: Path) -> set[str]:
    """Types of the messages of a bag; none of another database, or a damaged one."""
    try:
        with closing(_opened(path)) as bag:
            return {str(kind) for (kind,) in bag.execute("SELECT type FROM topics")}
    except (ValueError, sqlite3.Error):
        return set()


def bag_messages(path: Path) -> Iterator[tuple[str, str, str, int, bytes]]:
    """Yield (type, topic, encoding, time in ns, data) of all messages, by their times.

    Raises:
        ValueError: the database is damaged, or is no bag.
    """
    try:
        with closing(_opened(path)) as bag:
            check = bag.execute("PRAGMA quick_check(1)").fetchone()
            if check != ("ok",):
                raise ValueError(f"the database is damaged: {check[0] if check else 'no answer'}")
            topics = {
                key: (str(kind), str(name), str(form))
                for key, name, kind, form in bag.execute(
                    "SELECT id, name, type, serialization_format FROM topics"
                )
            }
            rows = bag.execute(
                "SELECT topic_id, timestamp, data FROM messages ORDER BY timestamp, id"
            )
            for topic, time, data in rows:
                if topic not in topics:
                    raise ValueError(f"a message of topic {topic}, which the bag does not list")
                if not isinstance(time, int) or not isinstance(data, bytes):
                    raise ValueError(
                        "a message whose time is no integer, or whose data are no bytes"
                    )
                yield *topics[topic], time, data
    except sqlite3.Error as error:
        raise ValueError(f"the database cannot be read: {error}") from None


def _opened(path: Path) -> sqlite3.Connection:
    """Open a read-only connection that runs nothing a stranger wrote, within limits of time and size.

    A database may hold views and computed columns: programs, which can run for ever or return any
    amount of data. (Checks of rows are computed by no read-only connection.)

    Raises:
        ValueError: topics or messages are no plain tables.
        sqlite3.Error: the file cannot be read.
    """
    bag = sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro&immutable=1", uri=True)
    try:
        bag.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, min(current().decoded, 2**31 - 1))
        end = process_time() + current().seconds
        bag.set_progress_handler(lambda: process_time() > end, 100_000)
        for name in ("topics", "messages"):
            table = bag.execute(_TABLE, (name,)).fetchone()
            if table is None:
                raise ValueError(f"the database is no ROS 2 bag: it has no table {name!r}")
            if table != ("table", 1, 0):
                raise ValueError(f"the database is no ROS 2 bag: {name!r} is no plain table")
    except BaseException:
        bag.close()
        raise
    return bag


_TABLE = """SELECT type, rootpage > 0, (SELECT count(*) FROM pragma_table_xinfo(?1) WHERE hidden > 0)
FROM sqlite_master WHERE lower(name) = ?1"""
"""Query: the type of a name's entry, whether it is stored, and how many columns are computed."""
