"""The file of labels: a line for every answer, on disk before it counts as given."""

from __future__ import annotations

import csv
import io
import os
import sys
import threading
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path

from safestage_eval._text.csv_cell import guarded
from safestage_eval.errors import InputError
from safestage_eval.metrics.labels import COLUMNS, Label, last_of_each, read_labels

if sys.platform != "win32":
    import fcntl

LONGEST_NOTE = 4000


class Ledger:
    """A CSV file of labels that only grows; the last label of a reviewer on an episode counts.

    A line is written with one call and synced, so that neither a killed process nor several that
    share the file lose or mix answers.
    """

    def __init__(self, path: Path) -> None:
        """Open a file, or name one that will be made with the first label.

        Raises:
            InputError: it is there, but is no such file, or it cannot be written.
        """
        self.path = path
        self._lock = threading.Lock()
        self._labels: dict[tuple[str, str], Label] = {}
        if path.is_file() and path.stat().st_size:
            self._columns = _columns(path)
            self._labels = {(x.reviewer, x.episode_id): x for x in last_of_each(read_labels(path))}
        else:
            self._columns = list(COLUMNS)
        _check_writable(path)

    @property
    def reviewers(self) -> list[str]:
        """Names of the reviewers who have labelled something."""
        return sorted({reviewer for reviewer, _ in self._labels})

    def of(self, reviewer: str) -> dict[str, Label]:
        """Episode id → the last label of a reviewer."""
        return {x.episode_id: x for x in [*self._labels.values()] if x.reviewer == reviewer}

    def add(self, label: Label) -> None:
        """Append a label; it is on disk when this returns.

        Raises:
            OSError: it could not be written, and does not count.
        """
        cells = {
            "episode_id": label.episode_id,
            "label": label.label,
            "reviewer": label.reviewer,
            "note": label.note[:LONGEST_NOTE],
            "labelled_at": datetime.now(UTC).isoformat(timespec="seconds"),
        }
        with self._lock:
            self._append([cells.get(name, "") for name in self._columns])
            self._labels[label.reviewer, label.episode_id] = label

    def _append(self, row: list[str]) -> None:
        self.path.parent.mkdir(parents=True, exist_ok=True)
        handle = os.open(self.path, os.O_RDWR | os.O_APPEND | os.O_CREAT, 0o644)
        try:
            _lock(handle)
            size = os.fstat(handle).st_size
            text = _line(row)
            if not size:
                text = _line(self._columns) + text
            else:
                os.lseek(handle, size - 1, os.SEEK_SET)
                if os.read(handle, 1) != b"\n":
                    text = "\n" + text  # an editor left the last line open
            data = text.encode()
            if os.write(handle, data) != len(data):
                raise OSError("the disk is full: the last line may be incomplete")
            os.fsync(handle)
        finally:
            os.close(handle)


def _lock(handle: int) -> None:
    """Keep other writers out until the file is closed: two of them would both write its first line."""
    if sys.platform != "win32":
        with suppress(OSError):  # network file systems without locks
            fcntl.flock(handle, fcntl.LOCK_EX)


def _line(cells: list[str]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow(map(guarded, cells))
    return text.getvalue()


def _columns(path: Path) -> list[str]:
    """Read the columns of an existing file. Raises InputError if labels do not fit in."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            columns = next(csv.reader(file), [])
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(str(path), f"cannot be read as CSV: {error}.") from None
    missing = [name for name in ("episode_id", "label", "reviewer") if name not in columns]
    if missing and columns:
        raise InputError(
            str(path),
            f"lacks the column {', '.join(missing)}.",
            f"a CSV file with the columns {', '.join(COLUMNS)}",
            "name another file with --labels",
        )
    return columns or list(COLUMNS)


def _check_writable(path: Path) -> None:
    place = path if path.exists() else path.parent
    while not place.exists():
        place = place.parent
    if path.is_dir() or not os.access(place, os.W_OK):
        raise InputError(str(path), "cannot be written.", fix="name another file with --labels")
