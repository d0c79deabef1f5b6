"""Human labels of episodes: safe, unsafe or unsure."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

from safestage_eval.errors import InputError

from .read_rows import cell_text, demand_columns, read_rows

Answer = Literal["safe", "unsafe", "unsure"]
ANSWERS: tuple[Answer, ...] = get_args(Answer)

COLUMNS = ("episode_id", "label", "reviewer", "note", "labelled_at")
"""Columns of a label file; the first two are required."""

ALLOWED = "a table with the columns episode_id and label, and perhaps reviewer and note, as safestage label writes"


@dataclass(frozen=True)
class Label:
    """One answer of one reviewer.

    Attributes:
        episode_id: of the episode.
        label: the answer.
        reviewer: whose; empty where nobody is named.
        note: what the reviewer added.
        where: the place it was read from, for messages: ``labels.csv, row 12``.
    """

    episode_id: str
    label: Answer
    reviewer: str = ""
    note: str = ""
    where: str = ""


def read_labels(path: str | Path, reviewer: str = "") -> list[Label]:
    """Read the labels in a CSV, Parquet, JSON or JSON lines file, row by row.

    Args:
        path: the file.
        reviewer: whose labels they are where a row names nobody.

    Raises:
        InputError: it cannot be read, lacks a column, or a row has another answer.
    """
    result = []
    for number, row in enumerate(read_rows(path, COLUMNS, ALLOWED), 1):
        where = f"{path}, row {number}"
        demand_columns(row, COLUMNS[:2], where, ALLOWED)
        text = cell_text(row["label"]).lower()
        answer = next((name for name in ANSWERS if name == text), None)
        if answer is None:
            raise InputError(where, f"label is {row['label']!r}.", ", ".join(ANSWERS))
        name = cell_text(row["episode_id"])
        if not name:
            raise InputError(where, "names no episode.")
        who = cell_text(row.get("reviewer")) or reviewer
        result.append(Label(name, answer, who, cell_text(row.get("note")), where))
    return result


def last_of_each(labels: Iterable[Label]) -> list[Label]:
    """Keep the last label of each reviewer on each episode, in the order of the first ones."""
    return [*{(label.reviewer, label.episode_id): label for label in labels}.values()]
