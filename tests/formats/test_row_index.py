"""Whose rows are where: by the file's own index, by its statistics, or by its columns of names."""

import json
from collections import Counter

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from recordings import everything
from test_stored_contacts import stacked

from safestage_eval.episode import Body, Geom, Header
from safestage_eval.errors import TraceError
from safestage_eval.formats import TraceWriter, discover, load, save
from safestage_eval.formats.digests import Seal
from safestage_eval.formats.parquet import row_index
from safestage_eval.formats.parquet.column_chunks import read_chunks_of
from safestage_eval.formats.parquet.row_index import METADATA_KEY, load_row_index
from safestage_eval.formats.parquet.stored_table import StoredTable
from safestage_eval.formats.parquet.table_file import TableFile


@pytest.fixture
def dataset(tmp_path):
    everything().close(tmp_path / "ds")
    return tmp_path / "ds"


def the_only(dataset, table):
    [file] = (dataset / table).iterdir()
    return file


def index_of(file, table):
    metadata = pq.read_metadata(file)
    size = metadata.serialized_size
    return load_row_index(metadata, table, file.stat().st_size, lambda: read_chunks_of(file, size))


def restated(file, change):
    """Return the file with another text as its index."""
    source = pq.ParquetFile(file)
    text = change(source.metadata.metadata.get(METADATA_KEY))
    groups = [source.read_row_group(i) for i in range(source.num_row_groups)]
    with pq.ParquetWriter(file, source.schema_arrow, compression="lz4") as writer:
        for group in groups:
            writer.write_table(group, row_group_size=len(group))
        if text is not None:
            writer.add_key_value_metadata({METADATA_KEY: text})


def with_end(file, text):
    """An index that fits where the file's columns end."""
    end = file.stat().st_size - 8 - pq.read_metadata(file).serialized_size
    return json.dumps({**json.loads(text), "end": end})


@pytest.mark.parametrize("table", ["bodies", "contacts", "frames", "geometry", "channels"])
def test_a_written_index_says_what_the_columns_say(dataset, table):
    file = the_only(dataset, table)
    index = index_of(file, table)
    assert index.stated
    metadata = pq.ParquetFile(file)
    for number, members in enumerate(index.members):
        rows = metadata.read_row_group(number)
        assert members == row_index.runs_to_members(row_index.runs_of(table, rows))


@pytest.mark.parametrize("table", ["bodies", "contacts"])
def test_of_a_file_with_an_index_no_column_of_names_is_read(dataset, table, monkeypatch):
    read, original = [], TableFile.read

    def spied(self, groups, columns):
        read.extend(columns)
        return original(self, groups, columns)

    monkeypatch.setattr(TableFile, "read", spied)
    places = StoredTable(the_only(dataset, table), table).places(0)
    assert len(places) > 0
    assert not read


@pytest.mark.parametrize(
    "broken",
    [
        lambda text: b"",
        lambda text: b"[]",
        lambda text: b"[" * 100_000,
        lambda text: b"\xff",
        lambda text: json.dumps({**json.loads(text), "version": 2}),
        lambda text: json.dumps({**json.loads(text), "groups": []}),
        lambda text: json.dumps({**json.loads(text), "names": [1, None]}),
        lambda text: json.dumps({**json.loads(text), "groups": [[[0, 99, 5]]]}),
        lambda text: json.dumps({**json.loads(text), "groups": [[[0, -1, 2**70]]]}),
        lambda text: text,  # right but for the file that it was written into
    ],
)
def test_an_index_that_is_broken_or_of_another_file_is_not_believed(dataset, broken):
    truth = load(dataset).content_hash
    file = the_only(dataset, "bodies")
    restated(file, broken)
    assert not index_of(file, "bodies").stated
    assert load(dataset).content_hash == truth
    assert {len(track.position) for track in load(dataset).tracks.values()} > {1}


def test_an_index_that_names_other_bodies_is_noticed(tmp_path):
    """The seal holds whom rows were about; without one the content hash does."""
    box = Geom(kind="box", size=(0.1, 0.1, 0.1))
    writer = TraceWriter(Header(episode_id="e", physics_dt=0.01, frame_dt=0.01))
    for name in ("cup", "tin"):
        writer.add_body(Body(name=name, kind="object", geoms=(box,)))
    for i in range(3):
        poses = {name: ((x, 0, 0), (1, 0, 0, 0)) for x, name in enumerate(("cup", "tin"))}
        writer.add_frame(0.01 * i, poses)
    writer.close(tmp_path)
    file = the_only(tmp_path, "bodies")
    text = pq.read_metadata(file).metadata[METADATA_KEY]
    restated(file, lambda _: None)
    swapped = text.replace(b'"cup","tin"', b'"tin","cup"')
    assert swapped != text
    restated(file, lambda _: with_end(file, swapped))
    assert index_of(file, "bodies").stated
    with pytest.raises(TraceError, match="not what was written"):
        load(tmp_path).tracks["cup"].position  # noqa: B018


def by_frame(rows):
    order = np.lexsort((rows["body"].to_numpy(zero_copy_only=False), rows["frame_index"]))
    return rows.take(pa.array(order))


LAYOUTS = {
    "one group, zstd": {"compression": "zstd"},
    "one group, snappy, no statistics": {"compression": "snappy", "write_statistics": False},
    "groups across bodies": {"compression": "zstd", "row_group_size": 37},
    "small pages": {"compression": "gzip", "data_page_size": 200},
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_files_that_others_wrote_anew_are_the_same_episode(tmp_path, layout):
    truth = stacked("e", 60)
    save(truth, tmp_path)
    for table in ("bodies", "contacts", "frames", "geometry"):
        file = the_only(tmp_path, table)
        rows = pq.read_table(file)
        plain = pa.table([
            c.cast(pa.string()) if pa.types.is_dictionary(c.type) else c for c in rows.columns
        ], rows.column_names)  # fmt: skip
        pq.write_table(plain, file, **LAYOUTS[layout])
        assert not index_of(file, table).stated
    [ref] = discover(tmp_path)
    episode = ref.open()
    for name, track in truth.tracks.items():
        assert np.array_equal(episode.tracks[name].position, track.position)
    assert episode.contacts.pairs == truth.contacts.pairs
    assert episode.content_hash == truth.content_hash


def test_rows_in_the_order_of_frames_are_the_same_episode(tmp_path):
    truth = stacked("e", 30)
    save(truth, tmp_path)
    file = the_only(tmp_path, "bodies")
    pq.write_table(by_frame(pq.read_table(file)), file)
    [ref] = discover(tmp_path)
    episode = ref.open()
    for name, track in truth.tracks.items():
        assert np.array_equal(episode.tracks[name].orientation, track.orientation)
    assert episode.content_hash == truth.content_hash


def test_the_same_rows_in_one_row_group_are_not_hashed_anew(tmp_path, monkeypatch):
    save(stacked("e", 60), tmp_path)
    for table in ("bodies", "contacts"):
        file = the_only(tmp_path, table)
        pq.write_table(pq.read_table(file), file)
    differing = []
    monkeypatch.setattr(Seal, "differs", lambda self, what: differing.append(what))
    [ref] = discover(tmp_path)
    episode = ref.open()
    assert sum(len(track.position) for track in episode.tracks.values())
    assert sum(len(episode.contacts.of_pair(p, "force")[0]) for p in episode.contacts.pairs)
    assert not differing


@pytest.mark.parametrize(("table", "column"), [("bodies", "position.x"), ("contacts", "force.z")])
def test_edited_numbers_are_noticed_in_whatever_row_groups(tmp_path, table, column):
    save(stacked("e", 60), tmp_path)
    file = the_only(tmp_path, table)
    rows = pq.read_table(file)
    values = rows[column].to_numpy().copy()
    values[7] += 1
    place = rows.column_names.index(column)
    rows = rows.set_column(place, rows.schema.field(place), pa.array(values))
    pq.write_table(rows, file, row_group_size=50)
    episode = discover(tmp_path)[0].open()
    with pytest.raises(TraceError, match="content hash"):
        _ = [track.position for track in episode.tracks.values()]
        _ = [episode.contacts.of_pair(p, "force") for p in episode.contacts.pairs]


def test_columns_that_episodes_share_are_decoded_once(tmp_path, monkeypatch):
    """Read a shard that another library wrote as one row group."""
    truth = [stacked(f"e{n}", n) for n in (40, 60, 50)]
    for episode in truth:
        save(episode, tmp_path)
    files = sorted((tmp_path / "bodies").iterdir())
    whole = pa.concat_tables([pq.read_table(file) for file in files]).unify_dictionaries()
    for other in files:
        pq.write_table(whole, other)
    decoded, original = Counter(), TableFile.read

    def spied(self, groups, columns):
        decoded.update((self.path, column) for column in columns if "bodies" in str(self.path))
        return original(self, groups, columns)

    monkeypatch.setattr(TableFile, "read", spied)
    for ref, episode in zip(discover(tmp_path), truth, strict=True):
        opened = ref.open()
        for name, track in episode.tracks.items():
            assert np.array_equal(opened.tracks[name].position, track.position)
    assert set(decoded.values()) == {1}
