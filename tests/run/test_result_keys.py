"""Keys of results: the same from what was kept of headers as from the headers, until these change."""

from dataclasses import replace

import pytest
from studio import block

from safestage_eval.formats import discover, save
from safestage_eval.run import result_keys
from safestage_eval.run.result_keys import Keys
from safestage_eval.run.settings import load_settings


@pytest.fixture
def dataset(tmp_path):
    for i in range(3):
        save(block(f"e{i}", room=0.01 * i), tmp_path / "dataset")
    return tmp_path / "dataset"


def keys_of(dataset, known=None):
    found = Keys(load_settings(["fsh"]), known)
    return {ref.episode_id: found.of(ref) for ref in discover(dataset)}


def test_headers_that_were_read_are_understood_no_more(dataset, tmp_path, monkeypatch):
    known, truth = tmp_path / "headers", keys_of(dataset)
    assert len({*truth.values()}) == 3
    assert keys_of(dataset, known) == truth
    monkeypatch.setattr(result_keys, "read_rows", lambda _: pytest.fail("the rows were read"))
    assert keys_of(dataset, known) == truth


def test_a_header_that_changed_and_damage_are_noticed(dataset, tmp_path):
    known, truth = tmp_path / "headers", keys_of(dataset)
    keys_of(dataset, known)
    whole = known.read_bytes()
    for place in range(0, len(whole), 7):
        known.write_bytes(whole[:place] + bytes([whole[place] ^ 1]) + whole[place + 1 :])
        assert keys_of(dataset, known) == truth
    known.write_bytes(whole)
    (path,) = (dataset / "meta/episodes").glob("*0.parquet")
    other = block("e0", room=0)
    header = other.header.model_copy(update={"instruction": "another one"})
    save(replace(other, header=header), tmp_path / "other")
    (new,) = (tmp_path / "other/meta/episodes").glob("*.parquet")
    path.write_bytes(new.read_bytes())
    changed = keys_of(dataset, known)
    assert changed == keys_of(dataset)
    assert {name for name in truth if truth[name] != changed[name]} == {"e0"}


def test_code_that_changed_understands_headers_anew(dataset, tmp_path, monkeypatch):
    known, truth = tmp_path / "headers", keys_of(dataset)
    keys_of(dataset, known)
    monkeypatch.setattr(result_keys, "code_version", lambda: "another")
    anew = keys_of(dataset, known)
    assert anew == keys_of(dataset)
    assert not {*anew.values()} & {*truth.values()}
