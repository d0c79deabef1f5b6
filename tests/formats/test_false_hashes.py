"""A file that states a content hash which is not that of its data is a listed problem."""

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
from safestage_eval.formats.digests import seal
from safestage_eval.formats.mcap.mcap_metadata import checksum
from safestage_eval.formats.save import save
from safestage_eval.rules import load_rules
from safestage_eval.run.result_keys import Keys
from safestage_eval.run.score_episode import score_episode
from safestage_eval.run.settings import load_settings
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


def problem(path):
    [ref] = discover(path)
    found = score_episode(ref, rules())
    assert isinstance(found, Problem), found
    return found.message


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


@pytest.mark.parametrize("digests", [True, False])
def test_a_header_row_that_states_another_hash(one, digests):
    edit_row(one, content_hash="0" * 64, **({} if digests else {"digests": None}))
    assert "content hash" in problem(one)


@pytest.mark.parametrize("digests", [True, False])
def test_data_edited_under_the_old_hash(one, digests):
    edit_bodies(one, "position.z", 0.25)
    if not digests:
        edit_row(one, digests=None)
    message = problem(one)
    assert "content hash" in message
    assert not digests or "position.z" in message


def test_the_hash_of_another_episode(one, other):
    edit_row(one, content_hash=row(other)["content_hash"])
    assert "content_hash" in problem(one)


def test_hash_and_digests_of_another_episode(one, other):
    theirs = row(other)
    edit_row(one, content_hash=theirs["content_hash"], digests=theirs["digests"])
    assert "content hash" in problem(one)


def test_hashes_of_two_episodes_exchanged(one, other):
    mine, theirs = row(one), row(other)
    edit_row(one, content_hash=theirs["content_hash"])
    edit_row(other, content_hash=mine["content_hash"])
    assert "content_hash" in problem(one)
    assert "content_hash" in problem(other)


@pytest.mark.parametrize("digests", [True, False])
def test_an_empty_hash(one, digests):
    edit_row(one, content_hash="", **({} if digests else {"digests": None}))
    assert "content hash" in problem(one)


def test_a_corrected_mass_under_the_old_hash(one):
    bodies = json.loads(row(one)["bodies"])
    for body in bodies:
        body["mass"] = 7.0
    edit_row(one, bodies=json.dumps(bodies))
    assert "content hash" in problem(one)


def test_a_corrected_name_keeps_the_hash(one):
    edit_row(one, task="another task", policy="p")
    [ref] = discover(one)
    assert score_episode(ref, rules()).trace_hash == recorded().content_hash


def test_a_forged_hash_with_digests_and_seal_made_to_fit_is_found_by_validate(one):
    mine, lie = row(one), "0" * 64
    document = json.loads(mine["digests"])["crc32"]
    forged = {"crc32": document, "seal": seal(lie, recorded().header, document)}
    edit_row(one, content_hash=lie, digests=json.dumps(forged))
    assert "its hash is" in " ".join(map(str, validate(one)))


def test_a_digest_that_is_not_that_of_its_column(one):
    digests = json.loads(row(one)["digests"])
    digests["crc32"]["bodies"] = [line[:-1] + "?" for line in digests["crc32"]["bodies"]]
    edit_row(one, digests=json.dumps(digests), content_hash="0" * 64)
    assert "content hash" in problem(one)


def test_results_that_are_kept_are_found_by_hash_and_digests(one, other):
    keys = Keys(load_settings(["fsh"]))
    [mine], [theirs] = discover(one), discover(other)
    before = keys.of(mine), keys.of(theirs)
    edit_row(one, digests=row(other)["digests"])
    [lying] = discover(one)
    assert Keys(load_settings(["fsh"])).of(lying) not in before


def test_rows_written_anew_in_other_groups_are_the_same_data(one):
    for table in ("bodies", "contacts"):
        [file] = (one / table).glob("*.parquet")
        pq.write_table(pq.read_table(file), file, row_group_size=7)
    [ref] = discover(one)
    assert score_episode(ref, rules()).trace_hash == recorded().content_hash


def test_an_older_file_without_digests_has_its_hash_computed(one):
    edit_row(one, digests=None)
    [ref] = discover(one)
    assert score_episode(ref, rules()).trace_hash == recorded().content_hash


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
    assert score_episode(discover(mcap_with(path))[0], rules()).trace_hash
    for changes in (
        {"content_hash": "0" * 64},
        {"content_hash": ""},
        {"content_hash": row(other)["content_hash"]},
    ):
        assert "content hash" in problem(mcap_with(path, **changes))


def test_both_forms_state_the_same_hash(tmp_path, one):
    save(load(one), tmp_path / "copy.mcap")
    again = save(load(tmp_path / "copy.mcap"), tmp_path / "again")
    assert again.content_hash == row(one)["content_hash"]


def test_an_episode_that_was_changed_since_it_was_read_has_a_hash_of_its_own(one):
    episode = load(one)
    assert episode.trace_hash == episode.content_hash
    later = replace(episode, t=episode.t + 1)
    assert later.trace_hash == later.content_hash != episode.content_hash
