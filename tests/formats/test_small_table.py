"""Small tables that are read without pyarrow hold what pyarrow reads, or are left to it."""

import numba  # noqa: F401 — the quick way is taken where it is loaded
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from safestage_eval.formats.byte_source import LocalSource
from safestage_eval.formats.parquet.parquet_footer import COMPRESSED, FIRST_PAGE, read_footer
from safestage_eval.formats.parquet.small_table import read_records

KINDS = {
    "name": "string", "body": "dictionary", "count": "int32", "seed": "int64", "success": "bool",
    "horizon": "double", "size": "list<double>",
}  # fmt: skip
OURS = {
    "compression": "lz4",
    "use_dictionary": ["name", "body"],
    "column_encoding": {
        "count": "DELTA_BINARY_PACKED",
        "seed": "DELTA_BINARY_PACKED",
        "horizon": "BYTE_STREAM_SPLIT",
        "size.list.element": "BYTE_STREAM_SPLIT",
    },
    "write_page_checksum": True,
    "write_statistics": ["body"],
}
SCHEMA = pa.schema(
    {
        "name": pa.string(),
        "body": pa.dictionary(pa.int16(), pa.string()),
        "count": pa.int32(),
        "seed": pa.int64(),
        "success": pa.bool_(),
        "horizon": pa.float64(),
        "size": pa.list_(pa.float64()),
    }
)
doubles = st.floats(allow_nan=False)
row = st.fixed_dictionaries(
    {
        "name": st.none() | st.text(max_size=5),
        "body": st.none() | st.sampled_from(["cup", "plate", "Näpfchen", ""]),
        "count": st.none() | st.integers(-(2**31), 2**31 - 1),
        "seed": st.none() | st.integers(-(2**63), 2**63 - 1) | st.integers(-3, 3),
        "success": st.none() | st.booleans(),
        "horizon": st.none() | doubles,
        "size": st.none() | st.lists(doubles, max_size=4),
    }
)


def both(path, kinds=KINDS):
    file = LocalSource(path)
    return read_records(file, read_footer(file), 0, kinds), pq.read_table(path).to_pylist()


@settings(max_examples=60)
@given(st.lists(row, min_size=1, max_size=40), st.integers(1, 40))
def test_the_same_rows(tmp_path_factory, rows, times):
    path = tmp_path_factory.getbasetemp() / "small.parquet"
    pq.write_table(pa.Table.from_pylist(rows * times, SCHEMA), path, **OURS)
    found, told = both(path)
    wide = any(  # differences of more than 32 bits are left to pyarrow
        abs((a["seed"] or 0) - (b["seed"] or 0)) >= 2**31 for a in rows for b in rows
    )
    assert found == told or (found is None and wide)


def test_every_kind_of_column_and_any_number_of_pages(tmp_path):
    rows = [
        {"name": f"n{i % 300}", "body": "cup", "count": i, "seed": -i, "success": i % 3 == 0,
         "horizon": i / 7, "size": [0.5] * (i % 4)}
        for i in range(5000)
    ]  # fmt: skip
    path = tmp_path / "many.parquet"
    pq.write_table(pa.Table.from_pylist(rows, SCHEMA), path, **OURS, data_page_size=2000)
    found, told = both(path)
    assert found == told == rows


@pytest.mark.parametrize(
    "other",
    [
        {"compression": "zstd"},
        {"use_dictionary": False},
        {"column_encoding": None},
        {"data_page_version": "2.0"},
    ],
)
def test_what_others_write_is_left_to_pyarrow(tmp_path, other):
    rows = [{"name": "a", "body": "b", "count": 1, "seed": 2, "horizon": 0.5, "size": [1.0]}]
    path = tmp_path / "f.parquet"
    pq.write_table(pa.Table.from_pylist(rows * 9, SCHEMA), path, **{**OURS, **other})
    assert both(path)[0] is None


def test_other_kinds_and_missing_columns_are_left_to_pyarrow(tmp_path):
    path = tmp_path / "f.parquet"
    pq.write_table(pa.Table.from_pylist([{"count": 1, "size": [1.0, None]}], SCHEMA), path, **OURS)
    assert both(path, {"count": "int32"})[0] == [{"count": 1}]
    for kinds in ({"count": "int64"}, {"size": "double"}, {"count": "list<double>"},
                  {"size": "list<double>"}, {"weight": "double"}):  # fmt: skip
        assert both(path, kinds)[0] is None


def test_no_damage_passes_as_data(tmp_path):
    """Of every single byte of the columns: turned over, it is noticed."""
    path = tmp_path / "f.parquet"
    rows = [
        {"name": f"n{i}", "body": "ab"[i % 2], "count": i, "seed": 7, "success": i < 3,
         "horizon": 0.1 * i, "size": [0.1] * (i % 3)}
        for i in range(8)
    ]  # fmt: skip
    pq.write_table(pa.Table.from_pylist(rows, SCHEMA), path, **OURS)
    file, whole = LocalSource(path), path.read_bytes()
    footer = read_footer(file)
    end = int((footer.chunks[0, :, FIRST_PAGE] + footer.chunks[0, :, COMPRESSED]).max())
    noticed = 0
    for at in range(4, end):
        for flip in (1, 12, 255):
            path.write_bytes(whole[:at] + bytes([whole[at] ^ flip]) + whole[at + 1 :])
            found = read_records(LocalSource(path), footer, 0, KINDS)
            assert found is None or found == rows
            noticed += found is None
    assert noticed > 500
