"""One pair's contacts read alone are those that the whole table has of the pair."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from strategies import episodes

from safestage_eval.episode import Body, Geom, Header
from safestage_eval.errors import TraceError
from safestage_eval.formats import TraceWriter, discover, save
from safestage_eval.formats.parquet import dataset_reader
from safestage_eval.formats.parquet.table_file import TableFile

COLUMNS = ("frame", "force", "normal", "peak_force", "force.z", "geom1", "depth", "position")


def sorted_rows(columns):
    """The rows of a pair in a fixed order, as one array."""
    rows = np.column_stack([np.asarray(c, np.float64) for c in columns])
    return rows[np.lexsort(rows.T)]


def assert_same_pairs(stored, truth, in_order=False):
    assert stored.pairs == truth.pairs
    for pair in [*truth.pairs, (3, 5)]:
        found = stored.of_pair(pair, *COLUMNS)
        expected = truth.of_pair(pair, *COLUMNS)
        np.testing.assert_array_equal(sorted_rows(found), sorted_rows(expected))
        if in_order:  # by slot, so that the sums of a frame are the same to the last bit
            order = np.argsort(found[0], kind="stable")
            np.testing.assert_array_equal(found[1][order], expected[1])


@settings(max_examples=30)
@given(episodes(), st.sampled_from([None, 1, 3, 1000]), st.booleans(), st.integers(0, 99))
def test_a_pair_alone_is_the_pair_of_the_table(tmp_path_factory, episode, groups, shuffle, seed):
    dataset = tmp_path_factory.mktemp("pairs")
    save(episode, dataset)
    (file,) = (dataset / "contacts").glob("*.parquet")
    if groups is not None:  # as another writer may have it
        rows = pq.read_table(file)
        if shuffle:
            rows = rows.take(np.random.default_rng(seed).permutation(len(rows)))
        pq.write_table(rows, file, row_group_size=groups)
    (ref,) = discover(dataset)
    assert_same_pairs(ref.open().contacts, episode.contacts, in_order=groups is None)
    at_once = ref.open(whole=True)
    assert_same_pairs(at_once.contacts, episode.contacts, in_order=groups is None)
    assert len(at_once.contacts) == len(episode.contacts)
    for body, track in episode.tracks.items():
        for name, column in track.columns.items():
            np.testing.assert_array_equal(getattr(at_once.tracks[body], name), column)
    unchecked = ref.open(checked=False, whole=True).contacts
    for pair in episode.contacts.pairs if groups is None else ():  # in the same order, too
        for mine, own in zip(
            unchecked.of_pair(pair, *COLUMNS), episode.contacts.of_pair(pair, *COLUMNS), strict=True
        ):
            np.testing.assert_array_equal(mine, own)


@settings(max_examples=20)
@given(episodes(), st.booleans(), st.booleans())
def test_rows_in_any_order_are_those_of_the_table(tmp_path_factory, episode, shuffle, whole):
    dataset = tmp_path_factory.mktemp("rows")
    save(episode, dataset)
    if shuffle:
        (file,) = (dataset / "contacts").glob("*.parquet")
        rows = pq.read_table(file)
        pq.write_table(rows.take(np.random.default_rng(1).permutation(len(rows))), file)
    (ref,) = discover(dataset)
    found = ref.open(whole=whole).contacts.unordered(*COLUMNS[:4])
    expected = episode.contacts.unordered(*COLUMNS[:4])
    np.testing.assert_array_equal(sorted_rows(found), sorted_rows(expected))


def stacked(episode_id, frames):
    """Cubes a, b, c on a table, in touch with it and with each other."""
    cube = Geom(kind="box", size=(0.1, 0.1, 0.1))
    writer = TraceWriter(Header(episode_id=episode_id, physics_dt=0.01, frame_dt=0.01))
    for name in ("table", "a", "b", "c"):
        fixed = ((0, 0, 0),) if name == "table" else ()
        writer.add_body(Body(name=name, kind="object", movable=not fixed, geoms=(cube,)), *fixed)
    rng = np.random.default_rng(frames)
    for n in range(frames):
        pose = ((0, 0, 0), (1, 0, 0, 0))
        rows = [
            {
                "body1": one,
                "body2": other,
                "position": rng.normal(size=3),
                "normal": (0, 0, 1),
                "force": rng.normal(size=3),
            }
            for one, other in (("table", "a"), ("table", "b"), ("a", "b"), ("b", "c"))
            for _ in range(rng.integers(0, 3))
        ]
        writer.add_frame(n / 100, dict.fromkeys("abc", pose), contacts=rows)
    return writer.episode()


def test_pairs_of_a_shard_with_several_episodes(tmp_path):
    truth = [stacked(f"e{n}", n) for n in (40, 60)]
    for episode in truth:
        save(episode, tmp_path)
    files = sorted((tmp_path / "contacts").glob("*.parquet"))
    whole = pa.concat_tables([pq.read_table(file) for file in files]).unify_dictionaries()
    for file in files:
        pq.write_table(whole, file, row_group_size=50)
    for ref, episode in zip(discover(tmp_path), truth, strict=True):
        assert_same_pairs(ref.open().contacts, episode.contacts)


def test_other_pairs_are_not_read(tmp_path, monkeypatch):
    episode = stacked("e", 9000)
    save(episode, tmp_path)
    monkeypatch.setattr(dataset_reader, "FEW_CONTACTS", 0)
    contacts = discover(tmp_path)[0].open().contacts
    contacts.pairs  # noqa: B018 — what pairs there are is known from here on
    read, original = [], TableFile.read

    def spied(self, groups, columns):
        read.append(list(columns))
        return original(self, groups, columns)

    monkeypatch.setattr(TableFile, "read", spied)
    contacts.of_pair((2, 3), "frame", "force.z")
    assert read == [["frame_index", "force.z"]]
    contacts.of_pair((2, 3), "force.z", "frame", "force.z")
    assert len(read) == 1
    contacts.of_pair((2, 3), "frame", "force", "force.y")
    assert read[1:] == [["force.x", "force.y", "force.z"]]


def test_few_contacts_are_read_at_once(tmp_path, monkeypatch):
    episode = stacked("e", 90)
    save(episode, tmp_path)
    contacts, read = discover(tmp_path)[0].open().contacts, []
    monkeypatch.setattr(TableFile, "read", lambda *_: read.append(1))
    wanted = "frame", "normal", "force.z", "peak_force"
    for pair in episode.contacts.pairs:
        found, expected = (table.of_pair(pair, *wanted) for table in (contacts, episode.contacts))
        np.testing.assert_array_equal(sorted_rows(found), sorted_rows(expected))
    assert not read


@pytest.mark.parametrize(
    ("column", "value", "message"),
    [
        ("frame_index", 40, "out of range"),
        ("force.z", np.inf, "not a finite number"),
        ("geom1", 3, "does not belong to body1"),
        ("geom2", 9, "out of range"),
    ],
)
def test_a_broken_pair_never_passes_as_data(tmp_path, column, value, message):
    save(stacked("e", 40), tmp_path)
    (file,) = (tmp_path / "contacts").glob("*.parquet")
    rows = pq.read_table(file)
    values = rows[column].to_numpy().copy()
    values[0] = value
    place = rows.schema.get_field_index(column)
    pq.write_table(rows.set_column(place, rows.schema.field(place), pa.array(values)), file)
    contacts = discover(tmp_path)[0].open().contacts
    with pytest.raises(TraceError, match=message):
        contacts.of_pair(contacts.pairs[0], "frame", "force.z", "geom1", "geom2")
