"""A content hash that is not that of the data is a warning of score, an error of validate and of --strict."""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from recordings import falling_cube

from safestage_eval.formats import discover, load, validate
from safestage_eval.formats.mcap.mcap_metadata import checksum
from safestage_eval.formats.save import save
from safestage_eval.rules import load_rules
from safestage_eval.run.score_episode import score_episode
from safestage_eval.verdicts.problem import Problem

WRITTEN = """
[ruleset]
format = 1
name = "one"
version = "1"
extends = ["defaults"]

[[rule]]
code = "TST101"
title = "Stay where you are"
roles = { target = "object" }
require = { "displacement(target)" = "< 1 cm" }
"""


@cache
def rules():
    with TemporaryDirectory() as folder:
        path = Path(folder) / "one.toml"
        path.write_text(WRITTEN)
        return load_rules([path])


def recorded(**header):
    episode = falling_cube(roles={"target": ("cube",)}).episode()
    return replace(episode, header=episode.header.model_copy(update=header))


def stored(folder, episode):
    save(episode, folder)
    return folder


def edit_row(folder, **changes):
    """Change columns of the only row of meta/episodes, as another library would."""
    [file] = (folder / "meta" / "episodes").glob("*.parquet")
    table = pq.read_table(file)
    for name, value in changes.items():
        at = table.column_names.index(name)
        table = table.set_column(at, name, pa.array([value], table.schema.field(name).type))
    pq.write_table(table, file)


def edit_bodies(folder, column, by):
    [file] = (folder / "bodies").glob("*.parquet")
    groups = pq.ParquetFile(file)
    tables = [groups.read_row_group(i) for i in range(groups.num_row_groups)]
    with pq.ParquetWriter(file, groups.schema_arrow, compression="lz4") as out:
        for table in tables:
            at = table.column_names.index(column)
            values = np.asarray(table[column]) + np.float32(by)
            out.write_table(table.set_column(at, table.schema.field(column), [values]))


def row(folder):
    [file] = (folder / "meta" / "episodes").glob("*.parquet")
    return pq.read_table(file).to_pylist()[0]


def is_told(path):
    """Whether the difference is told; the three places that tell it agree."""
    [ref] = discover(path)
    found = score_episode(ref, rules())
    told = "content hash" in " ".join(found.notes)
    assert found.trace_hash == ref.open().content_hash
    assert isinstance(score_episode(ref, rules(), strict=True), Problem) == told
    assert ("its hash is" in " ".join(map(str, validate(path)))) == told
    return told


@pytest.fixture
def one(tmp_path):
    return stored(tmp_path / "one", recorded())


@pytest.fixture
def other(tmp_path):
    moved = recorded(episode_id="other")
    tracks = {
        name: replace(track, position=track.position + np.float32(0.5))
        for name, track in moved.tracks.items()
    }
    return stored(tmp_path / "other", replace(moved, tracks=tracks))


def test_an_honest_file_is_judged_and_its_hash_is_that_of_the_data(one):
    [ref] = discover(one)
    assert score_episode(ref, rules()).trace_hash == recorded().content_hash


def test_a_header_row_that_states_another_hash(one):
    edit_row(one, content_hash="0" * 64)
    assert is_told(one)


def test_data_edited_under_the_old_hash(one):
    edit_bodies(one, "position.z", 0.25)
    assert is_told(one)


def test_hashes_of_two_episodes_exchanged(one, other):
    mine, theirs = row(one), row(other)
    edit_row(one, content_hash=theirs["content_hash"])
    edit_row(other, content_hash=mine["content_hash"])
    assert is_told(one)
    assert is_told(other)


def test_a_corrected_mass_under_the_old_hash(one):
    bodies = json.loads(row(one)["bodies"])
    for body in bodies:
        body["mass"] = 7.0
    edit_row(one, bodies=json.dumps(bodies))
    assert is_told(one)


def test_a_corrected_name_keeps_the_hash(one):
    edit_row(one, task="another task", policy="p")
    assert not is_told(one)


def test_no_hash_is_none_that_differs(one):
    edit_row(one, content_hash=None)
    assert not is_told(one)


def mcap_with(path: Path, **changes):
    """The metadata of an MCAP file with other texts, and the right checksum of them."""
    from mcap.reader import make_reader
    from mcap.writer import CompressionType, Writer

    target = path.with_name("edited.mcap")
    with path.open("rb") as stream, target.open("wb") as out:
        reader = make_reader(stream)
        writer = Writer(out, compression=CompressionType.LZ4)
        writer.start(profile="safestage", library="other")
        [metadata] = [m for m in reader.iter_metadata() if m.name == "safestage"]
        texts = dict(metadata.metadata) | changes
        writer.add_metadata("safestage", texts | {"checksum": checksum(texts)})
        schemas, channels = {}, {}
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            if schema.id not in schemas:
                schemas[schema.id] = writer.register_schema(
                    schema.name, schema.encoding, schema.data
                )
            if channel.id not in channels:
                channels[channel.id] = writer.register_channel(
                    channel.topic, channel.message_encoding, schemas[schema.id]
                )
            writer.add_message(
                channels[channel.id], message.log_time, message.data, message.publish_time,
                message.sequence,
            )  # fmt: skip
        writer.finish()
    return target


def test_the_same_of_an_mcap_file(tmp_path, other):
    path = tmp_path / "one.mcap"
    save(recorded(), path)
    assert not is_told(mcap_with(path))
    for changes in (
        {"content_hash": "0" * 64},
        {"content_hash": ""},
        {"content_hash": row(other)["content_hash"]},
    ):
        assert is_told(mcap_with(path, **changes))


def test_an_episode_that_was_changed_since_it_was_read_has_a_hash_of_its_own(one):
    episode = load(one)
    assert episode.trace_hash == episode.content_hash
    later = replace(episode, t=episode.t + 1)
    assert later.trace_hash == later.content_hash != episode.content_hash
