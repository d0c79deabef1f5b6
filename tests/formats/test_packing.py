"""Packing: nothing lost, nothing changed, nothing half done, and every library reads the result."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
import yaml
from recordings import falling_cube

from safestage_eval.errors import TraceError
from safestage_eval.formats import discover, load, packing, validate
from safestage_eval.formats.dataset_card import dataset_card
from safestage_eval.formats.packing import pack

TRACES = Path(__file__).resolve().parents[2] / "traces"


@pytest.fixture
def source(tmp_path):
    """Five recordings of different length, two tasks, one of them as MCAP."""
    folder = tmp_path / "source"
    for i in range(4):
        name = f"e{i}"
        falling_cube(name, frames=10 + i, task="drop" if i % 2 else "let go", policy="p/1").close(
            folder / "dataset"
        )
    falling_cube("e4", frames=7, task="drop", policy="p/1").close(folder / "single.mcap")
    return folder


def content(folder):
    return {ref.episode_id: ref.open().content_hash for ref in discover(folder)}


def files(folder):
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*.parquet"))


def test_every_episode_is_there_with_the_same_content(source, tmp_path):
    out = tmp_path / "out"
    before = content(source)
    result = pack(discover(source), out, shard_episodes=2)
    assert not result.problems
    assert content(out) == content(source) == before
    assert validate(out) == []
    assert set(result.packed) == set(before)


def test_groups_share_files_and_shards_have_a_limit(source, tmp_path):
    pack(discover(source), tmp_path / "a")
    assert [f for f in files(tmp_path / "a") if f.startswith("bodies")] == [
        "bodies/p-1_drop-000.parquet",
        "bodies/p-1_let-go-000.parquet",
    ]
    pack(discover(source), tmp_path / "b", by=(), shard_episodes=2)
    assert [f for f in files(tmp_path / "b") if f.startswith("bodies")] == [
        f"bodies/episodes-{i:03d}.parquet" for i in range(3)
    ]


def test_headers_channels_states_and_attachments_survive(tmp_path):
    recorded = next(iter(discover(TRACES)))
    pack([recorded], tmp_path / "out")
    one, other = recorded.open(), load(tmp_path / "out")
    assert one.header == other.header
    assert dict(one.attachments) == dict(other.attachments)
    assert sorted(one.meshes) == sorted(other.meshes)
    assert list(one.channels) == list(other.channels)
    assert sorted(one.states) == sorted(other.states)
    for frame in one.states:
        assert np.array_equal(one.states[frame], other.states[frame])


def test_a_second_run_adds_what_is_new_and_nothing_else(source, tmp_path):
    out = tmp_path / "out"
    refs = discover(source)
    pack(refs[:3], out)
    stored = {name: (out / name).read_bytes() for name in files(out)}
    again = pack(refs, out)
    assert sorted(again.there) == sorted(ref.episode_id for ref in refs[:3])
    assert set(again.packed) == {ref.episode_id for ref in refs[3:]}
    assert content(out) == content(source)
    assert all((out / name).read_bytes() == data for name, data in stored.items())


def test_a_broken_episode_keeps_none_of_the_others_out(source, tmp_path):
    table = source / "dataset/bodies/episode-000001.parquet"
    column = pq.ParquetFile(table).metadata.row_group(0).column(3)
    data = bytearray(table.read_bytes())
    data[column.data_page_offset + column.total_compressed_size - 5] ^= 0xFF
    table.write_bytes(data)
    result = pack(discover(source), tmp_path / "out", by=())
    assert [name for name, _ in result.problems] == ["e1"]
    assert set(content(tmp_path / "out")) == {"e0", "e2", "e3", "e4"}


def test_the_same_id_with_other_content_is_a_problem(tmp_path):
    for i, frames in enumerate((5, 6)):
        falling_cube("twin", frames=frames).close(tmp_path / f"{i}.mcap")
    result = pack(discover([tmp_path / "0.mcap", tmp_path / "1.mcap"]), tmp_path / "out")
    assert len(result.packed) == 1
    assert "another episode with this id" in result.problems[0][1]


def test_a_run_that_dies_leaves_no_half_shard(source, tmp_path, monkeypatch):
    out = tmp_path / "out"
    done = []

    def dying(ref):
        if len(done) == 3:
            raise KeyboardInterrupt
        done.append(ref)
        return ref.open()

    monkeypatch.setattr(packing, "_sound", dying)
    with pytest.raises(KeyboardInterrupt):
        pack(discover(source), out, shard_episodes=2, by=())
    monkeypatch.undo()
    assert len(content(out)) == 2
    assert validate(out) == []
    pack(discover(source), out, shard_episodes=2, by=())
    assert content(out) == content(source)
    assert not [path for path in out.rglob("*") if path.name.endswith((".part", ".lock"))]


def test_two_packers_do_not_share_a_folder(source, tmp_path):
    out = tmp_path / "out"
    with packing._alone_in(out), pytest.raises(TraceError, match="another process"):
        pack(discover(source), out)


def test_other_folders_are_left_alone(source, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (out / "thesis.tex").write_text("precious")
    with pytest.raises(TraceError, match="no dataset"):
        pack(discover(source), out)
    assert [path.name for path in out.iterdir()] == ["thesis.tex"]


def test_the_card_names_each_table_and_counts_the_episodes(source, tmp_path):
    out = tmp_path / "out"
    pack(discover(source), out)
    card = dataset_card(out, discover(out), title='The "drop" set', licence="cc0-1.0")
    meta = yaml.safe_load(card.split("---")[1])
    assert meta["license"] == "cc0-1.0"
    assert meta["pretty_name"] == 'The "drop" set'
    paths = {config["config_name"]: config["data_files"] for config in meta["configs"]}
    assert paths["episodes"] == "meta/episodes/*.parquet"
    for pattern in paths.values():
        assert list(out.glob(pattern))
    assert set(paths) == {"episodes", "bodies", "contacts", "frames", "geometry"}
    assert "| p/1 | – | – | 5 |" in card


READ_ALL = """
import json, sys
import duckdb, pandas, polars
from datasets import load_dataset
folder, cache, paths = sys.argv[1], sys.argv[2], json.loads(sys.argv[3])
rows, columns = {}, {}
for name, pattern in paths.items():
    files = f"{folder}/{pattern}"
    hub = load_dataset(folder, name, split="train", cache_dir=cache)
    lazy = polars.scan_parquet(files).collect()
    sql = duckdb.sql(f"select * from '{files}'")
    frame = pandas.read_parquet(files.rpartition("/")[0])
    rows[name] = [hub.num_rows, lazy.height, len(sql.fetchall()), len(frame)]
    columns[name] = [hub.column_names, lazy.columns, sql.columns, list(frame.columns)]
print(json.dumps([rows, columns]))
"""


@pytest.mark.slow
def test_datasets_polars_duckdb_and_pandas_read_every_table(tmp_path):
    out = tmp_path / "out"
    refs = [ref for ref in discover(TRACES) if "ish_bin" in ref.episode_id]
    pack(refs, out)
    (out / "README.md").write_text(dataset_card(out, discover(out), title="x"))
    meta = yaml.safe_load((out / "README.md").read_text().split("---")[1])
    paths = {config["config_name"]: config["data_files"] for config in meta["configs"]}
    ran = subprocess.run(
        [sys.executable, "-c", READ_ALL, out, tmp_path / "cache", json.dumps(paths)],
        env={"HF_HUB_OFFLINE": "1", "HF_HOME": str(tmp_path / "hf"), "HOME": str(tmp_path)},
        capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert ran.returncode == 0, ran.stderr
    rows, columns = json.loads(ran.stdout)
    frames = sum(len(ref.open()) for ref in refs)
    for name in paths:
        assert len(set(rows[name])) == 1, (name, rows[name])
        assert all(each == columns[name][0] for each in columns[name]), name
    assert rows["frames"][0] == frames
    assert rows["contacts"][0] == sum(len(ref.open().contacts) for ref in refs)
