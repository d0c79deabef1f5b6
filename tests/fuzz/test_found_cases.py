"""Hostile inputs that once ended the process, each made anew: now refused in words."""

import json
import os

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from codecs_of_files import codec_of
from import_targets import IMPORTS, in_json, transforms
from recordings import everything, falling_cube
from seeds import recorded

from safestage_eval.errors import InputError, TraceError
from safestage_eval.formats import load, save
from safestage_eval.formats.mcap.mcap_metadata import checksum, from_texts
from safestage_eval.formats.parquet.arrow_tables import schema, write_options
from safestage_eval.formats.parquet.table_file import TableFile
from safestage_eval.importers import Settings, import_all
from safestage_eval.importers.hdf5 import open_hdf5
from safestage_eval.metrics.read_rows import read_rows
from safestage_eval.rules import RuleErrors, load_bind, load_rules


@pytest.fixture
def dataset(tmp_path):
    everything().close(tmp_path / "ds")
    return tmp_path / "ds"


def the_only(dataset, table):
    [file] = (dataset / table).iterdir()
    return file


def rewritten(dataset, table, change):
    file = the_only(dataset, table)
    rows = pq.read_table(file).to_pylist()
    change(rows)
    pq.write_table(pa.Table.from_pylist(rows, schema(table)), file, **write_options(table))


def looked_at(dataset):
    episode = load(dataset)
    return episode.content_hash, dict(episode.attachments)


def test_sound_as_it_is(dataset):
    assert looked_at(dataset)


@pytest.mark.parametrize("table", ["bodies", "contacts", "frames", "geometry", "meta/episodes"])
@pytest.mark.parametrize("kind", ["pipe", "folder", "loop", "device", "outside"])
def test_other_things_in_the_place_of_a_table(dataset, tmp_path, table, kind):
    file = the_only(dataset, table)
    copy = tmp_path / "copy.parquet"
    file.rename(copy)
    if kind == "pipe":
        os.mkfifo(file)
    elif kind == "folder":
        file.mkdir()
    else:
        file.symlink_to({"loop": file, "device": "/dev/zero", "outside": copy}[kind])
    with pytest.raises(TraceError):
        looked_at(dataset)


def test_links_within_the_dataset_are_followed(dataset):
    file = the_only(dataset, "bodies")
    (dataset / "blobs").mkdir()
    file.rename(dataset / "blobs" / "0")
    file.symlink_to(dataset / "blobs" / "0")
    assert looked_at(dataset)


@pytest.mark.parametrize(
    "name", ["../x", "/etc/passwd", "..", "", "a/b", "a\\b", "C:x", "x" * 300, "a\nb"]
)
def test_names_that_lead_elsewhere(dataset, name):
    def change(rows):
        rows[0]["attachments"] = json.dumps({"task.toml": name})

    rewritten(dataset, "meta/episodes", change)
    with pytest.raises(TraceError, match="is none in assets"):
        looked_at(dataset)


def test_an_attachment_that_is_another_file(dataset):
    name = json.loads(pq.read_table(the_only(dataset, "meta/episodes"))["attachments"][0].as_py())
    (dataset / "assets" / name["task.toml"]).write_text("other")
    with pytest.raises(TraceError, match="has changed"):
        looked_at(dataset)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("orientation", [float("nan")] * 4),
        ("orientation", [0.0] * 4),
        ("orientation", [1e308, 0, 0, 0]),
        ("position", [0, 0, float("inf")]),
        ("position", [0, 0, 1e30]),
        ("friction", [-1.0, 0, 0]),
    ],
)
def test_shapes_that_cannot_be(dataset, field, value):
    rewritten(dataset, "geometry", lambda rows: rows[1].update({field: value}))
    with pytest.raises(TraceError, match=field):
        load(dataset)


def test_more_geoms_than_contacts_can_name(dataset):
    rewritten(dataset, "geometry", lambda rows: rows.extend(rows[:1] * 70_000))
    with pytest.raises(TraceError, match="geoms"):
        load(dataset)


@pytest.mark.parametrize(
    ("table", "column"),
    [
        ("contacts", "body1"),
        ("bodies", "body"),
        ("geometry", "body"),
        ("frames", "action"),
        ("states", "state"),
    ],
)
@pytest.mark.parametrize("kind", ["number", "text lists", "lists"])
def test_columns_of_another_kind(dataset, table, column, kind):
    if kind == "lists" and table in ("frames", "states"):
        return
    file = the_only(dataset, table)
    rows = pq.read_table(file)
    value = {"number": 1, "text lists": ["x"], "lists": [1.0]}[kind]
    place = rows.column_names.index(column)
    pq.write_table(rows.set_column(place, column, pa.array([value] * len(rows))), file)
    with pytest.raises(TraceError, match=column):
        episode = load(dataset)
        assert episode.content_hash
        assert [state.sum() for state in episode.states.values()]


WORDS = [
    (table, name)
    for table in ("bodies", "contacts", "geometry", "channels")
    for name in schema(table).names
    if pa.types.is_dictionary(schema(table).field(name).type)
]


@pytest.mark.parametrize("given", [[0], [1, None, 0], [-1, 0]])
@pytest.mark.parametrize(("table", "column"), WORDS)
def test_a_column_of_names_beyond_its_dictionary(dataset, monkeypatch, table, column, given):
    """Whatever is made of the column afterwards: pyarrow notices when it looks for the name."""
    stored = TableFile(the_only(dataset, table), table)
    rows = len(pq.read_table(stored.path))
    given = pa.array([*given, *[0] * rows][:rows], pa.int32())
    names = [] if len(set(given)) < 2 else ["a"]
    words = pa.DictionaryArray.from_arrays(given, pa.array(names, pa.string()), safe=False)
    monkeypatch.setattr(
        pq.ParquetFile, "read_row_groups", lambda *_, **__: pa.table({column: words})
    )
    with pytest.raises(TraceError, match=f"{column} refers to names"):
        stored.read([column])


def test_the_header_of_an_mcap_has_a_checksum(tmp_path):
    falling_cube("m").close(tmp_path / "m.mcap")
    data = (tmp_path / "m.mcap").read_bytes()
    at = data.index(b'"mass":0.2')
    (tmp_path / "m.mcap").write_bytes(data[: at + 9] + b"3" + data[at + 10 :])
    with pytest.raises(TraceError, match="checksum"):
        load(tmp_path / "m.mcap")
    texts = {"schema_version": "1.1", "a": "b"}
    assert checksum(texts) == checksum({**texts, "checksum": "x"})
    with pytest.raises(TraceError, match="checksum"):
        from_texts({**texts, "checksum": "x"}, "here")


@pytest.mark.parametrize(
    "way",
    ["external", "storage", "circle", "soft circle", "two in a circle", "ways", "nowhere", "huge"],
)
def test_ways_out_of_an_hdf5_file(tmp_path, way):
    source = IMPORTS["maniskill"](tmp_path).sources[0]
    with open_hdf5(source) as file:
        assert len(file)
    with h5py.File(source, "a") as file:
        group = file["traj_0"]
        if way == "external":
            group["x"] = h5py.ExternalLink("/etc/passwd", "/")
        elif way == "storage":
            group.create_dataset("x", (8,), "u1", external=[("/etc/passwd", 0, 8)])
        elif way == "circle":
            group["x"] = group
        elif way == "soft circle":
            group["x"] = h5py.SoftLink("/")
        elif way == "two in a circle":
            for here, there in ("ab", "ba"):
                file.create_group(here)["x"] = h5py.SoftLink(f"/{there}")
        elif way == "ways":  # twice as many with each group: 2 ** 25
            for n in range(25):
                inner = file.create_group(f"g{n}")
                for name in "xy":
                    if n:
                        inner[name] = file[f"g{n - 1}"]
        elif way == "nowhere":
            group["x"] = h5py.SoftLink("/nowhere")
        else:
            group.create_dataset("x", (2**40,), "f4", chunks=(1024,))
    with pytest.raises(InputError):
        open_hdf5(source)


@pytest.mark.parametrize(
    ("name", "what"),
    [("env_states/actors", "text"), ("success", "pairs"), ("env_states/articulations", "text")],
)
def test_other_things_in_the_place_of_numbers(tmp_path, name, what):
    target = IMPORTS["maniskill"](tmp_path)
    [source] = target.sources
    with h5py.File(source, "a") as file:
        group = file["traj_0"]
        del group[name]
        group[name] = "none" if what == "text" else np.zeros(8, [("a", "f4"), ("b", "i8")])
    [failed] = import_all(source, tmp_path / "out", target.settings).failed
    assert failed.message.startswith(f"{source}: traj_0")
    assert "bug in the" not in failed.message


@pytest.mark.parametrize(
    "row",
    [{"verdict": ["pass"]}, {"value": "cube"}, {"rollout": 10**30}, {"task": "\ud800"}],
)
def test_cells_that_cannot_be(tmp_path, row):
    path = tmp_path / "rows.json"
    path.write_text(json.dumps([row]))
    with pytest.raises(InputError, match="row 1"):
        read_rows(path)


def json_recording(path, transforms, scene=None):
    """Read one message of transforms and one of a scene."""
    path.write_bytes(in_json({"tf": [transforms, transforms], "scene": scene or {"entities": []}}))
    return import_all(path, path.with_suffix(""), Settings())


@pytest.mark.parametrize("lost", ["translation", "timestamp", "child_frame_id"])
def test_a_message_without_one_of_its_fields(tmp_path, lost):
    here = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
    one = {
        "timestamp": {"seconds": 1, "nanos": 0}, "parent_frame_id": "a", "child_frame_id": "b",
        "translation": here, "rotation": here,
    }  # fmt: skip
    del one[lost]
    [failed] = json_recording(tmp_path / "x.mcap", [one]).failed
    assert f"without {lost!r}" in failed.message
    one[lost] = here
    one["timestamp"] = {"seconds": 10**30, "nanos": 0}
    one["parent_frame_id"], one["child_frame_id"] = "a", "b"
    [failed] = json_recording(tmp_path / "y.mcap", [one]).failed
    assert "ns" in failed.message


def test_times_of_two_clocks(tmp_path):
    target, tree = IMPORTS["foxglove"](tmp_path), transforms()
    tree["tf"][-1][0]["timestamp"]["seconds"] = 1_700_000_000
    tree["tf"][0][1]["timestamp"]["nanos"] = 1
    tree["tf"][-1][1]["timestamp"]["seconds"] = 1_700_000_001
    tree["tf"][-1][1]["translation"]["x"] = 1.0
    (tmp_path / "x.mcap").write_bytes(in_json(tree))
    [failed] = import_all(tmp_path / "x.mcap", tmp_path / "out", target.settings).failed
    assert "frames" in failed.message


def test_rules_nested_without_end(tmp_path):
    path = tmp_path / "deep.toml"
    path.write_text("x = " + "[" * 100_000)
    with pytest.raises(RuleErrors):
        load_rules([path])
    with pytest.raises(RuleErrors):
        load_bind(path, load_rules(["ish"]))


def test_rules_extend_rule_files_only(tmp_path):
    (tmp_path / "secret").write_text("password = 1\n")
    path = tmp_path / "mine.toml"
    path.write_text('[ruleset]\nformat = 1\nname = "x"\nversion = "1.0.0"\nextends = ["secret"]\n')
    with pytest.raises(RuleErrors, match="not there") as caught:
        load_rules([path])
    assert "password" not in str(caught.value)


def test_a_damaged_state_of_an_mcap(tmp_path):
    path = tmp_path / "seed.mcap"
    save(recorded()[0], path)
    codec = codec_of(path.name)
    records = codec.read(path.read_bytes())
    for content in [c for _, c in records if isinstance(c, dict) and "records" in c]:
        inside = content["records"]
        channels = [c[:2] for kind, c in inside if kind == 4 and b"/safestage/state" in c]
        for each in inside:
            if each[0] == 5 and each[1][:2] in channels:
                each[1] = each[1][:-3]
    (tmp_path / "x.mcap").write_bytes(codec.write(records))
    with pytest.raises(TraceError, match="state cannot be read"):
        load(tmp_path / "x.mcap")
