"""Claims of a Parquet file cost no memory and end no process: they are refused in words."""

import subprocess
import sys

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from recordings import everything

from safestage_eval.errors import TraceError
from safestage_eval.formats import load
from safestage_eval.formats.parquet import table_file
from safestage_eval.formats.parquet.column_chunks import read_chunks_of
from safestage_eval.formats.parquet.row_index import load_row_index
from safestage_eval.formats.parquet.stored_table import Block, StoredTable


@pytest.fixture
def dataset(tmp_path):
    everything().close(tmp_path / "ds")
    return tmp_path / "ds"


@pytest.mark.parametrize("kind", range(7))
def test_a_footer_that_states_two_types_for_a_key_does_not_end_the_process(tmp_path, kind):
    """pyarrow ends it when it is asked for the statistics of such a column."""
    path = tmp_path / "f.parquet"
    names = {"episode_index": np.zeros(50, np.int32), "x": np.arange(50, dtype=np.float32)}
    pq.write_table(pa.table(names), path, compression="lz4", use_dictionary=False)
    data = path.read_bytes()
    begin = len(data) - 8 - int.from_bytes(data[-8:-4], "little")
    # an element of the schema: its type as the first field, then whether values may be missing
    name = b"\x25\x02\x18\x0depisode_index"
    other = data[begin:].replace(b"\x15\x02" + name, bytes([0x15, 2 * kind]) + name)
    assert (other != data[begin:]) == (kind != 1)
    path.write_bytes(data[:begin] + other)
    asked = (
        "import sys; from pathlib import Path; import pyarrow.parquet as pq;"
        "from safestage_eval.formats.parquet.row_index import load_row_index;"
        "from safestage_eval.formats.parquet.column_chunks import read_chunks_of;"
        "p = Path(sys.argv[1]); m = pq.read_metadata(p);"
        "chunks = lambda: read_chunks_of(p, m.serialized_size);"
        "print(load_row_index(m, 'frames', p.stat().st_size, chunks).members)"
    )
    done = subprocess.run(
        [sys.executable, "-c", asked, path], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("[{" if kind == 1 else "[None]")


def test_statistics_of_another_kind_say_nothing(tmp_path):
    path = tmp_path / "f.parquet"
    pq.write_table(pa.table({"episode_index": ["a", "b"], "body": [1, 2]}), path)
    metadata = pq.read_metadata(path)
    chunks = read_chunks_of(path, metadata.serialized_size)
    index = load_row_index(metadata, "bodies", path.stat().st_size, lambda: chunks)
    assert index.members == [None]
    assert index.episodes == [None]


@pytest.mark.parametrize("codec", ["lz4", "zstd", "snappy"])
def test_rows_beyond_the_bound_are_refused_before_they_are_read(tmp_path, monkeypatch, codec):
    monkeypatch.setattr(table_file, "LARGEST", 1 << 20)
    many = 400_000
    rows = {"episode_index": np.zeros(many, np.int32), "frame_index": np.zeros(many, np.int32)}
    path = tmp_path / "f.parquet"
    pq.write_table(pa.table(rows), path, compression=codec)
    assert path.stat().st_size < 100_000
    table = StoredTable(path, "frames")
    monkeypatch.setattr(pq.ParquetFile, "read_row_groups", lambda *_, **__: pytest.fail("read"))
    with pytest.raises(TraceError, match="rows would have to be read at once"):
        table.blocks((Block(("frame_index",), np.dtype(np.int32)),), 0)


@pytest.mark.parametrize("table", ["bodies", "contacts", "frames"])
def test_no_damage_of_the_columns_passes_as_data(dataset, table):
    """Inverted bytes anywhere in the columns are noticed."""
    truth = load(dataset).content_hash
    [file] = (dataset / table).iterdir()
    whole = file.read_bytes()
    end = len(whole) - 8 - int.from_bytes(whole[-8:-4], "little")
    noticed = 0
    for at in range(4, end, max(1, end // 60)):
        file.write_bytes(whole[:at] + bytes([whole[at] ^ 0x55]) + whole[at + 1 :])
        try:
            episode = load(dataset)
            _ = [track.columns for track in episode.tracks.values()]
            _ = [episode.contacts.of_pair(p, "force", "frame") for p in episode.contacts.pairs]
            assert episode.content_hash == truth
            _ = episode.frames
        except TraceError:
            noticed += 1
    assert noticed > 10


def test_a_footer_is_cut_off_or_too_long(dataset):
    [file] = (dataset / "bodies").iterdir()
    whole = file.read_bytes()
    for claimed in (0, 1, len(whole), 2**31 - 1, 2**32 - 1):
        file.write_bytes(whole[:-8] + claimed.to_bytes(4, "little") + b"PAR1")
        with pytest.raises(TraceError, match="not a whole Parquet file"):
            load(dataset).tracks["cube"].position  # noqa: B018
