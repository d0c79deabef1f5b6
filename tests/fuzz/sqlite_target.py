"""Hostile ROS 2 bags in SQLite: damaged pages, other rows, and programs in the place of tables."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path
from random import Random

from bags import as_sqlite
from damage import damaged
from strange import NAMES, NUMBERS, altered
from transforms_target import RosBag, _in_cdr, reordered

EDGES = (0, 16, 18, 20, 24, 28, 44, 52, 56, 60, 92, 96, 100, 103, 105, 108)
"""Bytes of the header of a database, and of its first page."""

ENDLESS = "WITH RECURSIVE n(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM n) SELECT"
COLUMNS = {
    "topics": ("id", "name", "type", "serialization_format"),
    "messages": ("id", "topic_id", "timestamp", "data"),
}


class SqliteBag(RosBag):
    """Messages in the tables of a database."""

    name = "ROS 2 bag in SQLite"
    read_by = ("rosbags",)

    def write(self, folder: Path) -> tuple[Path, str]:
        """One file."""
        self.sound = self.messages()
        (folder / "run0").mkdir(parents=True)
        bag = self._stored(_in_cdr(self.sound), folder / "run0/run_0.db3")
        self._size = bag.stat().st_size
        return bag, ""

    def _stored(self, mcap: bytes, to: Path) -> Path:
        twin = self.folder / "twin.mcap"
        twin.write_bytes(mcap)
        return as_sqlite(twin, to)

    def hurt(self, rng: Random, path: Path) -> tuple[str, bool]:
        """Other bytes, other messages, other rows, or other tables."""
        file = path / "run0/run_0.db3"
        kind = rng.random()
        if kind < 0.35:
            pages = [4096 * n + at for n in range(self._size // 4096) for at in (0, 3, 5, 8, 12)]
            data, what = damaged(rng, file.read_bytes(), [*EDGES, *pages])
            file.write_bytes(data)
            return what, what.startswith(("cut", "headless"))
        if kind < 0.55:
            what = self._said_otherwise(rng, file)
            return what, False
        script = rng.choice((_value, _value, _rows, _table))(rng)
        with closing(sqlite3.connect(file)) as bag:
            try:
                for statement, *values in script:
                    bag.execute(statement, values)
                bag.commit()
            except (sqlite3.Error, OverflowError, UnicodeEncodeError) as error:
                return f"{script[0][0]}: {error}", False
        return "; ".join(statement for statement, *_ in script)[:200], False

    def _said_otherwise(self, rng: Random, file: Path) -> str:
        while True:
            tree, what = self.sound, ""
            try:
                for _ in range(rng.choice((1, 1, 1, 3))):
                    tree, what = reordered(rng, tree) if rng.random() < 0.3 else altered(rng, tree)
                mcap = _in_cdr(tree)
            except Exception:  # noqa: BLE001 — what a writer refuses is no input
                continue
            file.unlink()
            self._stored(mcap, file)
            return what


Script = list[tuple[object, ...]]
"""Statements, each with its values."""


def _value(rng: Random) -> Script:
    """Another value in one row, or in all."""
    table = rng.choice(("topics", "messages"))
    column = rng.choice(COLUMNS[table])
    values = (*NAMES, *NUMBERS, None, b"", b"\0\1\0\0", b"\xff" * 99, 900_000_000)
    which = rng.choice(("", f" WHERE id = {rng.randrange(1, 9)}"))
    return [(f"UPDATE {table} SET {column} = ?{which}", rng.choice(values))]


def _rows(rng: Random) -> Script:
    """Rows that are gone, twice, or there by the thousand."""
    table = rng.choice(("topics", "messages"))
    rest = ", ".join(COLUMNS[table][1:])
    again = f"INSERT INTO {table}({rest}) SELECT {rest} FROM {table}"
    return rng.choice(
        (
            [(f"DELETE FROM {table} WHERE id = {rng.randrange(1, 9)}",)],
            [(f"DELETE FROM {table} WHERE id >= {rng.randrange(1, 9)}",)],
            [(f"{again} WHERE id = {rng.randrange(1, 9)}",)],
            [(again,)] * rng.choice((1, 10)),
            [("UPDATE messages SET timestamp = timestamp * ?", rng.choice((-1, 0, 10**9)))],
        )
    )


def _table(rng: Random) -> Script:
    """Something else in the place of a table."""
    table = rng.choice(("topics", "messages"))
    columns = COLUMNS[table]
    column = rng.choice(columns)
    kept = ", ".join(columns)
    view = f"CREATE VIEW {table} AS"
    moved = (f"ALTER TABLE {table} RENAME TO other",)
    endless = ", ".join(f"x AS {name}" for name in columns)
    return rng.choice(
        (
            [(f"DROP TABLE {table}",)],
            [moved],
            [moved, (f"{view} SELECT {kept} FROM other",)],
            [moved, (f"{view} {ENDLESS} {endless} FROM n",)],
            [moved, (f"{view} SELECT {kept} FROM other, (SELECT zeroblob(900000000))",)],
            [moved, (f"CREATE VIRTUAL TABLE {table} USING fts5({kept})",)],
            [moved, (f"CREATE TABLE {table}({kept})",)],
            [(f"ALTER TABLE {table} RENAME COLUMN {column} TO other",)],
            [(f"ALTER TABLE {table} ADD COLUMN more AS (zeroblob(900000000))",)],
            [(f"CREATE INDEX odd ON {table}(length(hex({column})))",)],
            [(f"CREATE TRIGGER odd AFTER INSERT ON {table} BEGIN DELETE FROM topics; END",)],
            [(f"ALTER TABLE {table} RENAME TO {table.upper()}",)],
        )
    )


TARGETS = {"sqlite": SqliteBag}
