"""Footers of Parquet files: sound ones read as by pyarrow, hostile ones do not end the process."""

import shutil
import subprocess
import sys
from itertools import product

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import thrift_tree as thrift
from exports import write_lerobot
from recordings import everything
from scenes import Scene

from safestage_eval.formats.parquet.column_chunks import read_chunks, read_chunks_of

TYPES = {
    "truth": pa.array([True, False, None]),
    "int32": pa.array([-5, 0, 2**31 - 1], pa.int32()),
    "int64": pa.array([-(2**63), None, 7], pa.int64()),
    "float": pa.array([1.5, -2.0, 0.0], pa.float32()),
    "text": pa.array(["mug é", "a" * 300, ""]),
    "dictionary": pa.array(["b", "a", "b"]).dictionary_encode(),
    "lists": pa.array([[1.0, 2.0], [], [3.0]]),
    "records": pa.array([{"a": 1, "b": ["x", "y"]}, None, {"a": 2, "b": []}]),
    "nothing": pa.nulls(3, pa.int32()),
}


def footer_of(data):
    """The footer's place and the tree of it."""
    begin = len(data) - 8 - int.from_bytes(data[-8:-4], "little")
    return begin, thrift.read(data, begin)[0]


def rewritten(path, change, *, lists=False):
    """Change column chunks of a file, of lists or all: ``change`` gets one and its metadata."""
    data = path.read_bytes()
    begin, tree = footer_of(data)
    for group in dict(tree.value)[4].value[1]:
        chunks = dict(group.value)[1].value[1]
        for i, chunk in enumerate(chunks):
            outer = dict(chunk.value)
            inner = dict(outer[3].value)
            if not lists or len(inner[3].value[1]) > 1:
                change(outer, inner)
            outer[3] = outer[3]._replace(value=sorted(inner.items()))
            chunks[i] = chunk._replace(value=sorted(outer.items()))
    footer = thrift.write(tree)
    path.write_bytes(data[:begin] + footer + len(footer).to_bytes(4, "little") + b"PAR1")


def numbers(*values):
    return thrift.Node(thrift.LIST, (thrift.I64, [thrift.Node(thrift.I64, n) for n in values]))


def histograms(_, column):
    """Size statistics with more levels than any schema here has."""
    levels = numbers(*range(9))
    column[16] = thrift.Node(thrift.RECORD, [(2, levels), (3, levels)])


def another_type(_, column):
    column[1] = column[1]._replace(value=(column[1].value + 1) % 7)


def encrypted(chunk, _):
    """With a key of the column's own, which nobody has."""
    path = thrift.Node(thrift.LIST, (thrift.TEXT, [thrift.Node(thrift.TEXT, b"x")]))
    key = thrift.Node(thrift.RECORD, [(1, path)])
    chunk[8] = thrift.Node(thrift.RECORD, [(2, key)])


def no_statistics_of_their_size(_, column):
    if 12 in column:
        ends = [(n, thrift.Node(thrift.TEXT, b"\xff")) for n in (1, 2, 5, 6)]
        column[12] = thrift.Node(thrift.RECORD, ends)


CONTRADICTIONS = [histograms, another_type, encrypted, no_statistics_of_their_size]


def ends_well(code, *arguments):
    """Run Python code in a process of its own, and return what it printed."""
    done = subprocess.run(
        [sys.executable, "-c", code, *map(str, arguments)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-800:]
    return done.stdout


READ = """
import sys
from pathlib import Path
from safestage_eval.errors import InputError
from safestage_eval.formats import load
for path in sys.argv[1:]:
    try:
        episode = load(Path(path))
        episode.tracks["mug é"].position, episode.contacts.pairs, episode.content_hash
        print("read:", episode.frames.action.shape)
    except InputError as error:
        print("told:", error)
"""


@pytest.mark.parametrize("place", ["any column", "lists"])
def test_a_footer_that_contradicts_itself_does_not_end_the_process(tmp_path, place):
    """Neither with the index that is written here, nor where statistics take its place."""
    everything().close(tmp_path / "ds")
    made = []
    for index, change in product((True, False), CONTRADICTIONS):
        made.append(tmp_path / f"{index} {change.__name__}")
        shutil.copytree(tmp_path / "ds", made[-1])
        for file in made[-1].glob("*/*.parquet"):
            if not index:
                pq.write_table(pq.read_table(file), file, compression="lz4", row_group_size=3)
            rewritten(file, change, lists=place == "lists")
    lines = ends_well(READ, *made).splitlines()
    assert len(lines) == len(made)
    assert all("not a whole Parquet file" in line or "read: (8, " in line for line in lines)
    assert "told:" in lines[0]


IMPORT = """
import sys
from pathlib import Path
from safestage_eval.errors import TraceError
from safestage_eval.importers.lerobot_tables import Tables
for path in sys.argv[1:]:
    try:
        print("read:", *Tables(Path(path)).read(0, ["action"], "map.toml"))
    except TraceError as error:
        print("told:", error)
"""


def test_nor_does_one_of_a_recording_that_is_imported(tmp_path):
    path = np.linspace((0, 0, 0.02), (0.3, 0.0, 0.02), 20)
    scene = Scene(20, 10.0).fixed("table").box("cube", 0.02, path)
    made = []
    for change in CONTRADICTIONS:
        made.append(tmp_path / change.__name__)
        write_lerobot(made[-1], [scene.episode(success=True, success_time=1.0)], "v2.1")
        for file in made[-1].rglob("data/**/*.parquet"):
            rewritten(file, change)
    lines = ends_well(IMPORT, *made).splitlines()
    assert len(lines) == len(made)
    assert all("cannot be read" in line or "read: action" in line for line in lines)
    assert "told:" in lines[0]


def test_columns_that_are_missing_from_a_row_group_are_reported(tmp_path):
    everything().close(tmp_path / "ds")
    [file] = (tmp_path / "ds/frames").iterdir()
    data = file.read_bytes()
    begin, tree = footer_of(data)
    group = dict(tree.value)[4].value[1][0]
    del dict(group.value)[1].value[1][-1]
    footer = thrift.write(tree)
    file.write_bytes(data[:begin] + footer + len(footer).to_bytes(4, "little") + b"PAR1")
    assert "told:" in ends_well(READ, tmp_path / "ds")


@pytest.mark.parametrize("rows", [1, 3, 60])
def test_sound_footers_are_read_as_pyarrow_reads_them(tmp_path, rows):
    path = tmp_path / "f.parquet"
    table = pa.concat_tables([pa.table(TYPES)] * 20)
    pq.write_table(table, path, row_group_size=rows)
    metadata = pq.read_metadata(path)
    groups = read_chunks_of(path, metadata.serialized_size)
    assert len(groups) == metadata.num_row_groups == 60 // rows
    for number, group in enumerate(groups):
        theirs = [metadata.row_group(number).column(i) for i in range(metadata.num_columns)]
        assert len(group) == len(theirs)
        for ours, column in zip(group, theirs, strict=True):
            assert ours.physical_type == column.physical_type
            assert ours.values == column.num_values
            statistics = column.statistics
            assert ours.nulls == (statistics.null_count or 0 if statistics else 0)
            if statistics is None or not statistics.has_min_max:
                assert ours.least is None or ours.greatest is None
            else:
                ends = [statistics.min_raw, statistics.max_raw]
                mine = [ours.least, ours.greatest]
                if column.physical_type.startswith("INT"):
                    mine = [int.from_bytes(end, "little", signed=True) for end in mine]
                if column.physical_type in ("FLOAT", "DOUBLE", "BOOLEAN"):
                    kinds = {"FLOAT": np.float32, "DOUBLE": np.float64, "BOOLEAN": np.bool_}
                    mine = [np.frombuffer(e, kinds[column.physical_type])[0] for e in mine]
                assert mine == ends


def test_a_footer_that_breaks_off_anywhere_is_reported(tmp_path):
    path = tmp_path / "f.parquet"
    pq.write_table(pa.table(TYPES), path)
    data = path.read_bytes()
    begin = len(data) - 8 - int.from_bytes(data[-8:-4], "little")
    for end in range(begin, len(data) - 9):
        with pytest.raises(ValueError, match="the footer"):
            read_chunks(data[begin:end])


def varint(n):
    return thrift.varint(n)


@pytest.mark.parametrize(
    ("footer", "told"),
    [
        (b"\x1c" * 10_000, "deep"),
        (b"\x19" * 10_000, "deep"),
        (b"\x1e", "unknown kind"),
        (b"\x16" + b"\xff" * 5000, "breaks off"),
        (b"\x49\xfc" + varint(2**60), "breaks off"),
        (b"\x19\xf7" + varint(2**60), "breaks off"),
        (b"\x1b" + varint(2**60) + b"\x11", "breaks off"),
        (b"\x06" + b"\x81" * 40, "64 bits"),
    ],
)
def test_hostile_footers_take_no_time_and_are_reported(footer, told):
    with pytest.raises(ValueError, match=told):
        read_chunks(footer)


def test_what_nobody_asks_for_is_stepped_over():
    """Every kind of value of Thrift's, before the row groups and within them."""
    values = [
        b"\x11", b"\x12", b"\x13\x00", b"\x14\x7f", b"\x15\x80\x01", b"\x16\x00",
        b"\x17" + bytes(8), b"\x18\x03PAR", b"\x1a\x35\x02\x04\x06", b"\x1b\x00",
        b"\x1b\x01\x85\x01a\x02", b"\x1c\x15\x02\x00", b"\x1d" + bytes(16), b"\x19\x21\x01\x02",
        b"\x19\xf1\x02\x01\x02",
    ]  # fmt: skip
    # fields 1001, 1002, …: a head of one byte counts on from the number before
    columns = b"\x19\x1c" + b"\x3c" + b"\x15\x02\x46\x0e\x00" + b"\x00" + b"\x00"
    groups = b"\x49\x1c" + columns
    many = b"".join(values)
    begin = b"\x03" + thrift.zigzag(1000) + b"\x00"
    [[chunk]] = read_chunks(groups + begin + many + b"\x00")
    assert (chunk.physical_type, chunk.values) == ("INT32", 7)
    assert read_chunks(begin + many + b"\x09" + thrift.zigzag(4) + groups[1:] + b"\x00") == [
        [chunk]
    ]
