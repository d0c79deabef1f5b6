"""Result rows as a DataFrame: SI, and of kinds that may be missing."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from safestage_eval.report.result_rows import COLUMNS, KINDS
from safestage_eval.units import DIMENSIONS, UNIT_DIMENSION, in_si

from .notebook_episode import si_unit

if TYPE_CHECKING:
    import pandas as pd

DTYPES = {"integer": "Int64", "boolean": "boolean", "number": "float64"}
"""Kind of a column → type; ``rows[rows.violation]`` takes an unknown truth as false."""


def in_si_units(row: Mapping[str, Any]) -> dict[str, Any]:
    """A row with value, limit and margin in SI; their unit says so."""
    unit = row["unit"]
    if unit not in UNIT_DIMENSION:
        return dict(row)
    dimension = UNIT_DIMENSION[unit]
    converted = {**row, "unit": si_unit(dimension)}
    for name in ("value", "limit"):
        converted[name] = None if row[name] is None else in_si(row[name], unit)
    if row["margin"] is not None:
        converted["margin"] = row["margin"] * DIMENSIONS[dimension][unit]
    return converted


def result_frame(rows: Iterable[Mapping[str, Any]]) -> pd.DataFrame:
    """Rows of ``report.result_rows``, columns of the kinds that these have."""
    import pandas as pd

    frame = pd.DataFrame([in_si_units(row) for row in rows], columns=list(COLUMNS))
    return frame.astype({name: DTYPES[kind] for name, kind in KINDS.items() if kind in DTYPES})
