"""The quick way through Parquet files says what pyarrow says, or that it cannot tell."""

import numba  # noqa: F401 — the quick way is taken where it is loaded
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from safestage_eval.formats.byte_source import LocalSource
from safestage_eval.formats.parquet.parquet_columns import Block, read_blocks
from safestage_eval.formats.parquet.parquet_footer import FIRST_PAGE, read_footer
from safestage_eval.formats.parquet.row_groups import Group

OURS = {
    "compression": "lz4",
    "use_dictionary": ["body"],
    "column_encoding": {
        "x": "BYTE_STREAM_SPLIT",
        "y": "BYTE_STREAM_SPLIT",
        "time": "BYTE_STREAM_SPLIT",
        "frame_index": "DELTA_BINARY_PACKED",
    },
    "write_page_checksum": True,
    "write_statistics": ["episode_index", "body"],
}


def numbers(rows, seed=0, roughness=1):
    """A table with floats of any bits, whole numbers of any size, names and lists."""
    rng = np.random.default_rng(seed)
    floats = rng.integers(0, 2**32, (2, rows), np.uint32).view(np.float32)
    floats[:, : rows // 2] = 0.25
    steps = rng.integers(-roughness, roughness + 1, rows)
    return pa.table(
        {
            "episode_index": np.repeat(np.arange(3, dtype=np.int32), rows)[:rows],
            "body": pa.array([f"body {i % 3}" for i in range(rows)]).dictionary_encode(),
            "x": floats[0],
            "list": pa.array([[1.0]] * rows),
            "y": floats[1],
            "time": rng.integers(0, 2**64, rows, np.uint64).view(np.float64),
            "frame_index": np.cumsum(steps).astype(np.int32),
        }
    )


def both(path, names, group=0):
    """Columns as read quickly, or None, and as pyarrow reads them."""
    file = LocalSource(path)
    footer = read_footer(file)
    dtype = {"frame_index": np.int32, "time": np.float64}.get(names[0], np.float32)
    known = read_blocks(file, footer, group, (Block(tuple(names), np.dtype(dtype)),))
    table = pq.ParquetFile(path).read_row_group(group, names)
    return known[0].array if known else None, table


@settings(max_examples=40)
@given(
    st.integers(1, 400) | st.sampled_from([8000, 20_000, 20_001, 45_000]),
    st.integers(0, 99),
    st.sampled_from([0, 1, 5, 1000, 2**31 - 1]),
    st.booleans(),
)
def test_the_same_bits(tmp_path_factory, rows, seed, roughness, optional):
    path = tmp_path_factory.getbasetemp() / "same.parquet"
    table = numbers(rows, seed, roughness)
    if not optional:
        table = table.cast(pa.schema([field.with_nullable(False) for field in table.schema]))
    pq.write_table(table, path, row_group_size=max(1, rows), **OURS)
    for names in (["x", "y"], ["y"], ["time"], ["frame_index"]):
        found, told = both(path, names)
        assert found is not None
        for i, name in enumerate(names):
            expected = told[name].combine_chunks().to_numpy()
            assert found[:, i].tobytes() == expected.tobytes()


@pytest.mark.parametrize(
    "other",
    [
        {"compression": "zstd"},
        {"compression": "none"},
        {"column_encoding": None},
        {"column_encoding": None, "use_dictionary": True},
        {"data_page_version": "2.0"},
    ],
)
def test_what_others_write_is_left_to_pyarrow(tmp_path, other):
    pq.write_table(numbers(100), tmp_path / "f.parquet", **{**OURS, **other})
    assert both(tmp_path / "f.parquet", ["x", "y"])[0] is None


def test_values_that_are_missing_are_left_to_pyarrow(tmp_path):
    table = numbers(100)
    table = table.set_column(2, "x", pa.array([None, *table["x"].to_pylist()[1:]], pa.float32()))
    pq.write_table(table, tmp_path / "f.parquet", **OURS)
    assert both(tmp_path / "f.parquet", ["x"])[0] is None
    assert both(tmp_path / "f.parquet", ["y"])[0] is not None


def test_lists_and_names_are_left_to_pyarrow(tmp_path):
    pq.write_table(numbers(100), tmp_path / "f.parquet", **OURS)
    for name in ("list", "body", "episode_index"):
        assert both(tmp_path / "f.parquet", [name])[0] is None


@pytest.mark.parametrize("rows", [1, 7, 100])
@pytest.mark.parametrize("statistics", [OURS["write_statistics"], False])
def test_the_footer_says_the_same(tmp_path, rows, statistics):
    path = tmp_path / "f.parquet"
    pq.write_table(
        numbers(100), path, row_group_size=rows, **{**OURS, "write_statistics": statistics}
    )
    file = LocalSource(path)
    footer = read_footer(file)
    told = pq.read_metadata(path)
    for i, group in enumerate(footer.groups):
        by_pyarrow, limits = told.row_group(i), {}
        for place, key in enumerate(("episode_index", "body")):
            found = by_pyarrow.column(place).statistics
            if found is not None:
                limits[key] = found.min, found.max
        assert group == Group(i, by_pyarrow.num_rows, limits)
    assert footer.columns == set(numbers(1).column_names)
    assert len(footer.groups) == -(-100 // rows)
    assert bool(footer.groups[0].limits) == bool(statistics)


def test_no_damage_passes_as_data(tmp_path):
    """Of every single byte of the columns: turned over, it is noticed."""
    path = tmp_path / "f.parquet"
    pq.write_table(numbers(60), path, **OURS)
    file = LocalSource(path)
    footer, whole = read_footer(file), path.read_bytes()
    noticed, wanted = 0, (Block(("x", "y"), np.dtype(np.float32)),)
    true = np.stack([both(path, ["x", "y"])[1][name].to_numpy() for name in "xy"], 1)
    for at in range(4, int(footer.chunks[0, :, FIRST_PAGE].max())):
        for flip in (1, 12, 255):
            path.write_bytes(whole[:at] + bytes([whole[at] ^ flip]) + whole[at + 1 :])
            file = LocalSource(path)
            found = read_blocks(file, footer, 0, wanted)
            if found:
                assert found[0].array.tobytes() == true.tobytes()
            else:
                noticed += 1
    assert noticed > 400
