"""Rows of ``meta/episodes``: which are read, and which tables are refused."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from recordings import falling_cube

from safestage_eval.errors import TraceError
from safestage_eval.formats.parquet.arrow_tables import EPISODES, REQUIRED
from safestage_eval.formats.parquet.episodes_table import read_row, read_rows


@pytest.fixture
def file(tmp_path):
    """Two recordings of different length, told of in one file."""
    for i in range(2):
        falling_cube(f"e{i}", frames=10 + 5 * i).close(tmp_path)
    first, second = sorted((tmp_path / "meta/episodes").glob("*.parquet"))
    both = pa.concat_tables([pq.read_table(first), pq.read_table(second)])
    second.unlink()
    pq.write_table(both.unify_dictionaries(), first)
    return first


def rewritten(file, change):
    """Return the file with another table in it."""
    pq.write_table(change(pq.read_table(file)), file)
    return file


def test_rows_hold_what_was_recorded(file):
    rows = read_rows(file)
    assert [(row["episode_id"], row["length"]) for row in rows] == [("e0", 10), ("e1", 15)]
    assert set(rows[0]) <= set(EPISODES)
    assert [read_row(file, row["episode_index"]) for row in rows] == rows


def test_only_the_columns_asked_for_are_read_and_one_that_is_not_there_is_left_out(file):
    rewritten(file, lambda table: table.drop_columns(["policy"]))
    assert read_rows(file, ("length", "policy")) == [{"length": 10}, {"length": 15}]


def test_an_index_has_one_row(file):
    with pytest.raises(TraceError, match="0 rows with episode_index 7"):
        read_row(file, 7)
    rewritten(file, lambda table: pa.concat_tables([table, table.slice(1)]))
    assert read_row(file, 0)["episode_id"] == "e0"
    with pytest.raises(TraceError, match="2 rows with episode_index 1"):
        read_row(file, 1)


def test_a_file_written_anew_is_read_anew(file):
    assert read_row(file, 1)["length"] == 15
    place = pq.read_table(file).schema.get_field_index("length")
    rewritten(file, lambda table: table.set_column(place, "length", pa.array([10, 99], pa.int64())))
    assert read_row(file, 1)["length"] == 99


@pytest.mark.parametrize("column", REQUIRED)
def test_what_must_be_there_is_there_and_has_no_gaps(file, column):
    whole = pq.read_table(file)
    with pytest.raises(TraceError, match=f"'{column}' is missing"):
        read_rows(rewritten(file, lambda table: table.drop_columns([column])))
    values = pa.array([None, whole[column][1].as_py()], whole.schema.field(column).type)
    holed = whole.set_column(whole.schema.get_field_index(column), column, values)
    with pytest.raises(TraceError, match=f"{column} is empty in 1 rows"):
        read_rows(rewritten(file, lambda _: holed))


@pytest.mark.parametrize(
    ("column", "values"),
    [("length", ["ten", "15"]), ("task", [1, 2]), ("episode_index", [0.0, 1.0])],
)
def test_values_of_another_kind_are_refused(file, column, values):
    place = pq.read_table(file).schema.get_field_index(column)
    rewritten(file, lambda table: table.set_column(place, column, pa.array(values)))
    with pytest.raises(TraceError, match=f"column '{column}' holds"):
        read_rows(file)


def test_integers_of_another_width_are_the_same_kind(file):
    place = pq.read_table(file).schema.get_field_index("length")
    values = pa.array(np.array([10, 15], np.int16))
    rewritten(file, lambda table: table.set_column(place, "length", values))
    assert [row["length"] for row in read_rows(file)] == [10, 15]
