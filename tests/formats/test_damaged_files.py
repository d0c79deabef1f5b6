"""Whatever happens to a file's bytes: an episode or a TraceError, never anything else."""

import shutil

import pytest
from foreign_mcap import foreign
from hypothesis import example, given, settings
from hypothesis import strategies as st
from recordings import falling_cube

from safestage_eval.errors import TraceError
from safestage_eval.formats import discover, load, validate


@pytest.fixture(scope="module")
def originals(tmp_path_factory):
    folder = tmp_path_factory.mktemp("originals")
    falling_cube("d").close(folder / "ds")
    falling_cube("m").close(folder / "m.mcap")
    return folder


def use(path):
    """Look at everything, as a scorer that meets the file in a campaign would."""
    for ref in discover(path):
        try:
            assert ref.open().content_hash
        except TraceError:
            assert validate(path)


def damaged(data, at, what):
    place = int(at * (len(data) - 1))
    if what == "cut":
        return data[:place]
    if what == "zeros":
        return data[:place] + bytes(min(64, len(data) - place)) + data[place + 64 :]
    if what == "twice":
        return data[:place] + data[max(0, place - 20) :]
    return data[:place] + bytes([data[place] ^ what]) + data[place + 1 :]


damage = st.sampled_from(["cut", "zeros", "twice"]) | st.integers(1, 255)


@settings(max_examples=300)
@given(st.floats(0, 1), damage)
def test_a_damaged_mcap(originals, tmp_path_factory, at, what):
    path = tmp_path_factory.getbasetemp() / "damaged.mcap"
    path.write_bytes(damaged((originals / "m.mcap").read_bytes(), at, what))
    use(path)


@settings(max_examples=150)
@given(
    st.sampled_from(["bodies", "contacts", "frames", "geometry", "meta/episodes"]),
    st.floats(0, 1),
    damage,
)
@example("contacts", 0.3125, 128)  # the name of a column is no text any more
def test_a_damaged_table(originals, tmp_path_factory, table, at, what):
    dataset = tmp_path_factory.getbasetemp() / "damaged"
    shutil.rmtree(dataset, ignore_errors=True)
    shutil.copytree(originals / "ds", dataset)
    [file] = (dataset / table).iterdir()
    file.write_bytes(damaged(file.read_bytes(), at, what))
    use(dataset)


@pytest.mark.parametrize("kind", [1, 3, 12])
def test_a_record_longer_than_the_file(originals, tmp_path, kind):
    path = tmp_path / "long.mcap"
    start = (originals / "m.mcap").read_bytes()[:8]
    path.write_bytes(start + bytes([kind]) + (2**64 - 1).to_bytes(8, "little") + b"...")
    with pytest.raises(TraceError):
        load(path)
    use(path)


@pytest.mark.parametrize(
    ("key", "text"),
    [
        ("header", "[]"),
        ("header", "null"),
        ("moving", "{}"),
        ("moving", "7"),
        ("moving", '["nobody", "cube"]'),
        ("fixed", "[]"),
        ("fixed", '{"table": [1, 2]}'),
        ("fixed", '{"table": "x"}'),
        ("channels", '["ab", 1]'),
        ("channels", "5"),
        ("frames", "many"),
        ("schema_version", ""),
    ],
)
def test_metadata_that_means_nothing(tmp_path, key, text):
    path = tmp_path / "e.mcap"
    foreign(path)
    assert load(path)
    foreign(path, **{key: text})
    for ref in discover(path):
        with pytest.raises(TraceError):
            ref.open()
    with pytest.raises(TraceError):
        load(path)
