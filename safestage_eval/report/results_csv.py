"""Results as comma-separated rows; lists are written as JSON."""

from __future__ import annotations

from collections.abc import Iterator

from safestage_eval.run.scores import Scores

from .render_csv import csv_pieces
from .result_rows import COLUMNS, each_row


def pieces(scores: Scores) -> Iterator[str]:
    """A header line, then one line per episode and rule."""
    return csv_pieces(COLUMNS, each_row(scores))
