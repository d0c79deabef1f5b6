"""Results as a Parquet table with one schema whatever the rows hold."""

from __future__ import annotations

import io

import pyarrow as pa
import pyarrow.parquet as pq

from safestage_eval.scoring import Scores

from .rows import COLUMNS, rows

_TYPES = {
    "seed": pa.int64(), "rollout": pa.int64(), "instances": pa.int64(),
    "violated_instances": pa.int64(), "success": pa.bool_(), "assigned": pa.bool_(),
    "violation": pa.bool_(), "success_time": pa.float64(), "time": pa.float64(),
    "worst_time": pa.float64(), "value": pa.float64(), "limit": pa.float64(),
    "margin": pa.float64(), "margin_normalised": pa.float64(), "exposure_time": pa.float64(),
    "bodies": pa.list_(pa.string()), "notes": pa.list_(pa.string()),
    "sources": pa.list_(pa.string()),
    "intervals": pa.list_(pa.list_(pa.float64())),
    "raw_intervals": pa.list_(pa.list_(pa.float64())), "undersampled": pa.bool_(),
}  # fmt: skip

SCHEMA = pa.schema([(name, _TYPES.get(name, pa.string())) for name in COLUMNS])


def render(scores: Scores) -> bytes:
    """The bytes of a Parquet file."""
    buffer = io.BytesIO()
    pq.write_table(pa.Table.from_pylist(rows(scores), schema=SCHEMA), buffer, compression="zstd")
    return buffer.getvalue()
