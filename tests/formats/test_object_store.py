"""Datasets in an object store: the same episodes, few requests, and no verdict from a broken line."""

import random
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from object_store import object_store, upload
from studio import block, run

from safestage_eval.errors import TraceError
from safestage_eval.formats import discover, load, remote_path, save
from safestage_eval.formats.remote_path import RemotePath, as_path
from safestage_eval.run import score_traces as runs
from safestage_eval.run.score_traces import Choice, score_paths
from safestage_eval.run.settings import load_settings

pytest.importorskip("moto")
remote = [pytest.mark.slow, pytest.mark.filterwarnings("ignore::DeprecationWarning")]


@pytest.fixture(scope="module")
def local(tmp_path_factory):
    folder = tmp_path_factory.mktemp("traces")
    for i in range(4):
        save(block(f"e{i}", room=0.006 * i), folder / "dataset")
        save(block(f"m{i}", room=0.006 * i), folder / "deeper" / f"m{i}.mcap")
    return folder


@pytest.fixture(scope="module")
def store():
    with object_store() as between:
        yield between


@pytest.fixture
def uri(store, local, monkeypatch):
    for name in ("ACCESS_KEY_ID", "SECRET_ACCESS_KEY"):
        monkeypatch.setenv(f"AWS_{name}", "test")
    monkeypatch.setenv("AWS_ENDPOINT_URL", store.url)
    monkeypatch.setenv("AWS_REGION", "us-east-1")
    remote_path.filesystem.cache_clear()
    store.calm()
    yield upload(local, store, "corpus")
    store.calm()
    remote_path.filesystem.cache_clear()


def told(scores):
    return [replace(result, path="") for result in scores.results]


def test_paths_in_a_store_behave_as_paths():
    path = as_path("s3://bucket/a/b.parquet")
    assert isinstance(path, RemotePath)
    assert str(path) == "s3://bucket/a/b.parquet"
    assert str(path.parents[1] / "meta" / "info.json") == "s3://bucket/meta/info.json"
    assert (path.name, path.suffix, path.parent.name) == ("b.parquet", ".parquet", "a")
    assert path == RemotePath("s3://bucket/a") / "b.parquet"
    assert not isinstance(as_path("traces/s3"), RemotePath)


class TestRemote:
    """With a server."""

    pytestmark = remote

    def test_the_same_episodes_with_the_same_verdicts(self, uri, local):
        here, there = discover(local), discover(uri)
        assert [ref.episode_id for ref in there] == [ref.episode_id for ref in here]
        assert [ref.fields for ref in there] == [ref.fields for ref in here]
        assert told(score_paths([uri], ["fsh"], jobs=1)) == told(
            score_paths([local], ["fsh"], jobs=1)
        )

    def test_worker_processes_read_it_too_and_results_are_kept(self, uri, local, store, tmp_path):
        choice = Choice(resume=tmp_path / "kept", jobs=1)
        first = runs.score_traces([uri], load_settings(["fsh"]), choice)
        assert told(first) == told(score_paths([local], ["fsh"], jobs=1))
        store.requests.clear()
        again = runs.score_traces([uri], load_settings(["fsh"]), choice)
        assert told(again) == told(first)
        bodies = [
            path for method, path, _ in store.requests if method == "GET" and "/bodies/" in path
        ]
        assert not bodies  # known by what the store says of them

    def test_nothing_is_fetched_twice_and_that_in_few_requests(self, uri, store, tmp_path):
        """Read one body's poses of a long episode with many bodies: its tables are read whole."""
        from made import Size, write

        write(tmp_path / "made", "FSH", Size(frames=6000, objects=20))
        there = upload(tmp_path / "made", store, "made")
        stored = sum(path.stat().st_size for path in (tmp_path / "made").rglob("*.parquet"))
        store.requests.clear()
        episode = load(there)
        poses = episode.tracks["upper"].position
        gets = [size for method, _, size in store.requests if method == "GET"]
        assert np.array_equal(poses, load(tmp_path / "made").tracks["upper"].position)
        assert sum(gets) < 1.05 * stored
        assert len(gets) < 40

    @pytest.mark.parametrize("kind", ["dataset", "deeper"])
    def test_each_object_is_asked_for_its_size_once(self, uri, store, kind):
        """By who looks for episodes and opens them in one process."""
        store.requests.clear()
        assert len(score_paths([f"{uri}/{kind}"], ["fsh"], jobs=1).results) == 4
        asked = Counter(path for method, path, _ in store.requests if method == "HEAD")
        episodes = {path: n for path, n in asked.items() if path.endswith((".mcap", ".parquet"))}
        assert len(episodes) >= 4
        assert set(episodes.values()) == {1}
        assert all(n <= 2 for path, n in asked.items() if path.endswith("info.json"))

    def test_an_object_that_is_replaced_is_noticed(self, uri, store, tmp_path, monkeypatch):
        """By the next look for episodes at once, by who kept a reference a minute later."""
        save(block("e", room=0.0), tmp_path / "one" / "e.mcap")
        save(block("e", room=0.012), tmp_path / "two" / "e.mcap")
        there = upload(tmp_path / "one", store, "changing")
        (ref,) = discover(there)
        first = ref.open().tracks["block"].position
        upload(tmp_path / "two", store, "changing")
        truth = load(tmp_path / "two").tracks["block"].position
        assert not np.array_equal(first, truth)
        assert np.array_equal(load(there).tracks["block"].position, truth)
        upload(tmp_path / "one", store, "changing")
        monkeypatch.setattr(remote_path, "FRESH", 0.0)
        assert np.array_equal(ref.open().tracks["block"].position, first)

    @pytest.mark.parametrize("seed", range(3))
    def test_a_store_that_fails_now_and_then_is_asked_again(self, uri, local, store, seed):
        chance = random.Random(seed)
        store.delay = 0.002
        store.failing = lambda number, path: chance.random() < 0.15
        found = score_paths([uri], ["fsh"], jobs=1)
        assert store.failed
        assert not found.problems
        assert told(found) == told(score_paths([local], ["fsh"], jobs=1))

    def test_a_store_that_fails_for_good_gives_problems_and_no_verdict(
        self, uri, local, store, monkeypatch
    ):
        monkeypatch.setattr(remote_path, "TRIES", 2)
        remote_path.filesystem.cache_clear()
        refs = discover(uri)
        store.failing = lambda number, path: "/bodies/" in path or "m1" in path
        truth = {r.episode_id: r for r in told(score_paths([local], ["fsh"], jobs=1))}
        found = score_paths([uri], ["fsh"], jobs=1)
        assert {r.episode_id for r in found.results} == {"m0", "m2", "m3"}
        assert all(result == truth[result.episode_id] for result in told(found))
        assert len(found.problems) == len(refs) - 3

    @pytest.mark.parametrize("what", ["nobody there", "always fails", "fails later"])
    def test_a_store_that_cannot_be_listed_is_reported_in_words(
        self, uri, store, monkeypatch, what
    ):
        monkeypatch.setattr(remote_path, "TRIES", 2)
        remote_path.filesystem.cache_clear()
        if what == "nobody there":
            monkeypatch.setenv("AWS_ENDPOINT_URL", "http://127.0.0.1:1")
            remote_path.filesystem.cache_clear()
        elif what == "always fails":
            store.failing = lambda number, path: True
        else:
            store.failing = lambda number, path: "deeper" in path
        done = run("score", uri, "-r", "fsh")
        assert done.code == 2
        assert "Traceback" not in done.err
        assert "cannot be read" in done.err

    def test_what_is_not_there_is_reported(self, uri):
        with pytest.raises(TraceError, match="no such file or folder"):
            discover(f"{uri}/nowhere")
