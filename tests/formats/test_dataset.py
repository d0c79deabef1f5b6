"""Parquet datasets: what is read when, shards, other writers, and recorders that die."""

import json
import multiprocessing
import subprocess
import sys

import numpy as np
import polars as pl
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from recordings import falling_cube

from safestage_eval.errors import TraceError
from safestage_eval.formats import discover, load, validate

TABLES = ("bodies", "contacts", "frames", "geometry", "meta/episodes")


@pytest.fixture
def dataset(tmp_path):
    """Two recordings of different length."""
    for i in range(2):
        falling_cube(f"e{i}", frames=10 + 5 * i).close(tmp_path)
    return tmp_path


def merge(dataset, file="shard"):
    """Put all file sets into one, as publishing does: the rows in row groups of any extent."""
    for table in TABLES:
        folder = dataset / table
        parts = sorted(folder.glob("*.parquet"))
        whole = pa.concat_tables([pq.read_table(part) for part in parts])
        for part in parts:
            part.unlink()
        if table == "meta/episodes":
            column = whole.schema.get_field_index("file")
            whole = whole.set_column(column, "file", pa.array([file] * len(whole)))
        pq.write_table(whole.unify_dictionaries(), folder / f"{file}.parquet", row_group_size=7)


def test_encodings_and_row_groups_are_as_documented(dataset):
    bodies = pq.ParquetFile(dataset / "bodies/episode-000001.parquet")
    assert bodies.metadata.num_row_groups == 1
    group = bodies.metadata.row_group(0)
    by_name = {group.column(i).path_in_schema: group.column(i) for i in range(group.num_columns)}
    assert by_name["position.x"].encodings == ("RLE", "BYTE_STREAM_SPLIT")
    assert by_name["frame_index"].encodings == ("RLE", "DELTA_BINARY_PACKED")
    assert by_name["body"].has_dictionary_page
    assert {column.compression for column in by_name.values()} == {"ZSTD"}


def test_a_shard_with_several_episodes_reads_like_the_single_files(dataset):
    before = [ref.open() for ref in discover(dataset)]
    hashes = [episode.content_hash for episode in before]
    merge(dataset)
    refs = discover(dataset)
    assert [ref.episode_id for ref in refs] == ["e0", "e1"]
    assert [ref.open().content_hash for ref in refs] == hashes
    assert validate(dataset) == []
    falling_cube("e2").close(dataset)  # goes on counting behind the shard
    assert sorted(ref.episode_index for ref in discover(dataset)) == [0, 1, 2]


def test_rows_written_by_another_library_are_understood(dataset):
    before = load(dataset, "e1").content_hash
    for table in TABLES:
        for file in (dataset / table).glob("*.parquet"):
            pl.read_parquet(file).write_parquet(file)  # plain strings, its own row groups
    assert load(dataset, "e1").content_hash == before


def test_contacts_in_any_order_make_the_canonical_table(dataset):
    before = load(dataset, "e1").content_hash
    file = dataset / "contacts/episode-000001.parquet"
    table = pq.read_table(file)
    pq.write_table(table.take(np.random.default_rng(0).permutation(len(table))), file)
    assert load(dataset, "e1").content_hash == before


def test_unknown_columns_of_a_newer_minor_are_ignored(dataset):
    for table in TABLES:
        for file in (dataset / table).glob("*.parquet"):
            rows = pq.read_table(file)
            pq.write_table(rows.append_column("mood", pa.nulls(len(rows))), file)
    assert validate(dataset) == []


@pytest.mark.parametrize(
    ("table", "column"),
    [
        ("meta/episodes", "length"),
        ("bodies", "orientation.w"),
        ("frames", "timestamp"),
        ("contacts", "force.z"),
        ("frames", "action"),
    ],
)
def test_a_missing_column_is_named_with_those_expected(dataset, table, column):
    file = dataset / table / "episode-000000.parquet"
    pq.write_table(pq.read_table(file).drop_columns([column]), file)
    with pytest.raises(TraceError, match=f"the column '{column}' is missing") as caught:
        read_all(file)
    assert str(file) in caught.value.where
    assert column in caught.value.allowed


def read_all(file):
    dataset = file.parents[2] if file.parts[-3] == "meta" else file.parents[1]
    episode = discover(dataset)[0].open()
    return episode.content_hash


@pytest.mark.parametrize("table", ["bodies", "contacts"])
def test_changed_bytes_do_not_go_unnoticed(dataset, table):
    file = dataset / table / "episode-000000.parquet"
    data = bytearray(file.read_bytes())
    for at in range(200, len(data) // 2, 97):
        data[at] ^= 0x5A
    file.write_bytes(data)
    with pytest.raises(TraceError, match=str(file)):
        read_all(file)


@pytest.mark.parametrize("table", ["bodies", "contacts", "frames", "geometry"])
def test_a_missing_table_is_named(dataset, table):
    file = dataset / table / "episode-000000.parquet"
    file.unlink()
    with pytest.raises(TraceError, match=f"the table '{table}' is missing"):
        read_all(file)


def edit(file, column, change):
    """Rewrite one column of a stored table by a function of its list of values."""
    table = pq.read_table(file)
    values = pa.array(change(table[column].to_pylist()), table.schema.field(column).type)
    pq.write_table(table.set_column(table.schema.get_field_index(column), column, values), file)


def with_value(index, value):
    return lambda values: [*values[:index], value, *values[index + 1 :]]


@pytest.mark.parametrize(
    ("table", "column", "change", "message"),
    [
        ("frames", "timestamp", with_value(3, 0.01), "time does not increase at frame 3"),
        ("frames", "timestamp", with_value(3, float("nan")), "time is not a finite number at row"),
        ("frames", "frame_index", with_value(3, 4), "not the frames 0…9 in order"),
        ("frames", "gripper", with_value(3, [1.0]), "rows of 'gripper' differ in length"),
        (
            "bodies",
            "orientation.w",
            with_value(5, 0.5),
            "orientation of 'cube' at frame 5 has norm",
        ),
        ("bodies", "frame_index", with_value(5, 7), "body 'cube' has 10 rows that are not"),
        ("bodies", "body", with_value(20, "desk"), "body names 'desk', which is no body"),
        ("contacts", "body1", with_value(0, "desk"), "body1 names 'desk', which is no body"),
        ("contacts", "frame_index", with_value(0, 10), "contact frame 10 is out of range"),
        ("contacts", "geom2", with_value(0, 2), "geom2 2 does not belong to body2 1"),
        ("geometry", "body", with_value(0, "desk"), "geometry names 'desk', which is no body"),
        ("geometry", "kind", with_value(0, "cone"), "bodies.0.geoms.0.kind: Input should be"),
        ("meta/episodes", "bodies", with_value(0, "[{"), "column bodies: not JSON"),
        ("meta/episodes", "frame_dt", with_value(0, 0.0), "frame_dt is 0.0"),
        (
            "meta/episodes",
            "schema_version",
            with_value(0, "2.0"),
            "trace format 2.0 cannot be read",
        ),
        ("meta/episodes", "contacts", with_value(0, 3), "has 1 contacts, not 3"),
    ],
)
def test_broken_values_never_pass_as_data(dataset, table, column, change, message):
    file = dataset / table / "episode-000000.parquet"
    edit(file, column, change)
    with pytest.raises(TraceError, match=message):
        read_all(file)
    assert any(message in str(error) for error in validate(dataset))
    assert load(dataset, "e1").content_hash


@pytest.mark.parametrize("kind", range(7))
def test_a_footer_that_states_two_types_for_a_key_does_not_end_the_process(tmp_path, kind):
    """pyarrow ends it when it is asked for the statistics of such a column."""
    path = tmp_path / "f.parquet"
    rows = {"episode_index": np.zeros(50, np.int32), "frame_index": np.arange(50, dtype=np.int32)}
    lists = pa.ListArray.from_arrays(np.arange(51, dtype=np.int32), np.zeros(50, np.float32))
    pq.write_table(pa.table(rows | {"action": lists}), path, use_dictionary=False)
    data = path.read_bytes()
    begin = len(data) - 8 - int.from_bytes(data[-8:-4], "little")
    # an element of the schema: its type as the first field, then whether values may be missing
    name = b"\x25\x02\x18\x0depisode_index"
    other = data[begin:].replace(b"\x15\x02" + name, bytes([0x15, 2 * kind]) + name)
    assert (other != data[begin:]) == (kind != 1)
    path.write_bytes(data[:begin] + other)
    asked = (
        "import sys; from pathlib import Path\n"
        "from safestage_eval.errors import TraceError\n"
        "from safestage_eval.formats.parquet.table_file import TableFile\n"
        "try: print(len(TableFile(Path(sys.argv[1]), 'frames').read(['action'], 0)))\n"
        "except TraceError as error: print(error)"
    )
    done = subprocess.run(
        [sys.executable, "-c", asked, path], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert (done.stdout == "50\n") == (kind == 1)


def test_a_newer_major_of_the_dataset_is_refused_for_reading_and_writing(dataset):
    info = dataset / "meta/info.json"
    info.write_text(json.dumps(json.loads(info.read_text()) | {"schema_version": "2.3"}))
    with pytest.raises(TraceError, match=r"2.3 cannot be read.*1.x.*newer safestage"):
        discover(dataset)[0].open()
    with pytest.raises(TraceError, match=r"2.3 cannot be read"):
        falling_cube().close(dataset)


def record_some(folder, name):
    for i in range(4):
        falling_cube(f"{name}{i}").close(folder)


def test_two_recorders_into_one_dataset_do_not_disturb_each_other(tmp_path):
    context = multiprocessing.get_context("spawn")
    both = [context.Process(target=record_some, args=(tmp_path, name)) for name in "ab"]
    for process in both:
        process.start()
    for process in both:
        process.join()
        assert process.exitcode == 0
    refs = discover(tmp_path)
    assert sorted(ref.episode_id for ref in refs) == [f"{n}{i}" for n in "ab" for i in range(4)]
    assert sorted(ref.episode_index for ref in refs) == list(range(8))
    assert validate(tmp_path) == []
