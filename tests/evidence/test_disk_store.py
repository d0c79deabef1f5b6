"""Verdicts from kept answers are those of the trace: for any parameters, files, code and processes."""

import os
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from recordings import falling_cube

from safestage_eval.episode import Track
from safestage_eval.evidence import disk_store
from safestage_eval.evidence.cache_folder import CacheFolder
from safestage_eval.evidence.disk_store import DiskStore
from safestage_eval.evidence.measure import Signals
from safestage_eval.evidence.query import Query
from safestage_eval.evidence.series import Series, exact
from safestage_eval.formats import EpisodeRef, discover, load, save
from safestage_eval.rules import load_rules
from safestage_eval.run.score_episode import score_episode
from safestage_eval.run.score_many import score_paths

TRACES = Path(__file__).parents[2] / "traces"
BUILTIN = ("ish", "ets", "fsh")

CHANGES = {
    "commit_lift": ("m", 0.002, 0.05),
    "commit_for": ("s", 0.0, 0.2),
    "safe_for": ("s", 0.0, 1.0),
    "contact_force": ("N", 0.01, 20.0),
    "moved": ("m", 0.001, 0.2),
    "still": ("m/s", 0.0005, 0.1),
    "min_clearance": ("m", 0.0, 0.3),
    "zone_reach": ("m", 0.0, 0.2),
    "zone_height": ("m", 0.0, 0.6),
    "edge": ("m", -0.02, 0.2),
    "upright": ("deg", 1.0, 60.0),
    "settle_time": ("s", 0.1, 3.0),
}
"""Parameter → unit and the range that it is drawn from."""


@st.composite
def overrides(draw):
    """Other values for some parameters, as written."""
    names = draw(st.lists(st.sampled_from(sorted(CHANGES)), unique=True, max_size=3))
    found = {}
    for name in names:
        unit, low, high = CHANGES[name]
        found[name] = f"{draw(st.floats(low, high)):.4f} {unit}"
    return found


@pytest.fixture(scope="module")
def shared(tmp_path_factory):
    """A cache that all examples of a test fill together."""
    return tmp_path_factory.mktemp("cache")


@pytest.fixture
def trusting(monkeypatch):
    """Files count as settled at once, so that those a test has just written can be remembered."""
    monkeypatch.setattr(disk_store, "RACY", 0)


@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.integers(0, 10**6), overrides(), st.booleans())
def test_remembered_verdicts_are_those_of_the_trace(trusting, shared, number, changed, assigned):
    refs = discover(TRACES)
    ref, rules = refs[number % len(refs)], load_rules(BUILTIN)
    truth = score_episode(ref, rules, changed, assigned_only=assigned)
    for _ in range(2):  # as it was left by other examples, and with everything at hand
        found = score_episode(ref, rules, changed, assigned_only=assigned, cache=shared)
        assert found == truth


def forbid_opening(monkeypatch):
    def refuse(self, **_):
        raise AssertionError("the trace was opened")

    monkeypatch.setattr(EpisodeRef, "open", refuse)


def test_a_changed_limit_needs_nothing_of_the_trace(trusting, tmp_path, monkeypatch):
    # of ISH a later commitment asks for dependence at frames that were not judged before
    refs = [ref for ref in discover(TRACES) if ref.fields["stage"] != "ISH"]
    rules = load_rules(BUILTIN)
    changed = {"min_clearance": "6 cm", "edge": "1 cm", "commit_lift": "12 mm"}
    truth = [score_episode(ref, rules, changed) for ref in refs]
    for ref in refs:
        score_episode(ref, rules, cache=tmp_path)
    forbid_opening(monkeypatch)
    assert [score_episode(ref, rules, changed, cache=tmp_path) for ref in refs] == truth


@pytest.fixture(params=["mcap", "parquet"])
def stored(request, tmp_path):
    """A trace in either format, whose cube falls."""
    path = tmp_path / ("cube.mcap" if request.param == "mcap" else "cubes")
    falling_cube("cube", roles={"target": ("cube",)}).close(path)
    return path


RULE = """
[ruleset]
format = 1
name = "fast"
version = "1"
extends = ["defaults.toml"]
[param]
fast = "1 m/s"
[[rule]]
code = "ETS900"
title = "Not so fast"
roles = { target = "object" }
forbid = { "speed(target)" = ">= fast" }
"""


@pytest.fixture
def rules(tmp_path):
    shutil.copy(TRACES.parent / "rules/defaults.toml", tmp_path)
    (tmp_path / "fast.toml").write_text(RULE, "utf-8")
    return load_rules([tmp_path / "fast.toml"])


def knows(folder, path):
    """Whether a cache would answer for the trace without reading it."""
    (ref,) = discover(path)
    return DiskStore(CacheFolder(folder), ref).about is not None


def test_a_trace_that_changed_is_read_again(trusting, stored, rules, tmp_path):
    cache = tmp_path / "cache"
    (ref,) = discover(stored)
    before = score_episode(ref, rules, cache=cache)
    assert knows(cache, stored)
    episode = load(stored)
    track = episode.tracks["cube"]
    velocities = track.linear_velocity * 0.1, track.angular_velocity
    start = track.position[:1]
    slow = Track(start + 0.1 * (track.position - start), track.orientation, *velocities)
    changed = replace(
        episode, tracks={**episode.tracks, "cube": slow}, _frames=episode.frames, _contacts=None
    )
    other = tmp_path / "other"
    save(changed, other / stored.name)
    files = [f for f in other.rglob("*") if f.is_file()]
    for file in files:  # same paths, sizes as they come, and the old times
        place = stored.parent / file.relative_to(other)
        old = place.stat()
        shutil.copyfile(file, place)
        os.utime(place, ns=(old.st_atime_ns, old.st_mtime_ns))
    assert not knows(cache, stored)
    after = score_episode(discover(stored)[0], rules, cache=cache)
    assert [v.verdict for v in before.verdicts] == ["violation"]
    assert [v.verdict for v in after.verdicts] == ["pass"]


def test_a_header_that_changed_is_read_again(trusting, stored, rules, tmp_path):
    cache = tmp_path / "cache"
    score_episode(discover(stored)[0], rules, cache=cache)
    if stored.is_dir():
        shutil.rmtree(stored)
    falling_cube("cube", roles={"target": ("ball",)}).close(stored)
    found = score_episode(discover(stored)[0], rules, cache=cache)
    assert found.verdicts[0].verdict == "pass"


def test_code_that_changed_measures_again(trusting, stored, rules, tmp_path, monkeypatch):
    cache = tmp_path / "cache"
    score_episode(discover(stored)[0], rules, cache=cache)
    assert knows(cache, stored)
    monkeypatch.setattr(disk_store, "code_version", lambda: "another")
    assert not knows(cache, stored)


def test_a_file_that_may_still_be_changing_is_not_trusted(stored, rules, tmp_path):
    cache = tmp_path / "cache"
    score_episode(discover(stored)[0], rules, cache=cache)
    assert not knows(cache, stored)


def test_a_file_that_changes_while_it_is_judged_is_not_kept(trusting, stored, rules, tmp_path):
    (ref,) = discover(stored)
    known = DiskStore(CacheFolder(tmp_path / "cache"), ref)
    Signals(known.episode, store=known).get("speed", ("cube",))
    ref.path.touch()
    known.save()
    assert not list((tmp_path / "cache").rglob("*.measured"))


def test_every_kind_of_answer_outlives_the_process(trusting, stored, tmp_path):
    (ref,) = discover(stored)
    folder = CacheFolder(tmp_path / "cache")
    bounds = Series(np.array([0.0, -np.inf, 2.0]), np.array([1.0, np.inf, 2.0]), "length", ("so",))
    wanted = np.array([False, True, True])
    answers = {
        "exact": exact(np.arange(3.0), "speed"), "bounds": bounds,
        "truth": np.array([True, False, True]),
    }  # fmt: skip
    for known in (DiskStore(folder, ref), DiskStore(folder, ref)):
        first = known.about is None
        asked = []

        def find(answer, asked=asked):
            return lambda *_: asked.append(1) or answer

        for name in ("exact", "bounds"):
            found = known.series(Query("signal", name), find(answers[name]))
            assert np.array_equal(found.lower, answers[name].lower)
            assert np.array_equal(found.upper, answers[name].upper)
            assert (found.dimension, found.notes) == (answers[name].dimension, answers[name].notes)
        assert known.column(Query("relation", "nowhere"), find(None)) is None
        assert known.column(Query("relation", "t"), find(answers["truth"])).tolist() == [1, 0, 1]
        assert known.value(Query("between frames", "a"), find(0.25)) == 0.25
        partial = known.partial(
            Query("signal", "costly"), wanted, find((np.array([1, 2]), exact([7.0, 8.0], "mass")))
        )
        assert partial.done.tolist() == wanted.tolist()
        assert partial.lower[wanted].tolist() == [7.0, 8.0]
        assert known.answer("who?", find([1, "two"])) == [1, "two"]
        assert len(asked) == (7 if first else 0)
        known.save()
    again = DiskStore(folder, ref).partial(
        Query("signal", "costly"), ~wanted, lambda _, at: (at, exact([6.0], "mass"))
    )
    assert again.lower.tolist() == [6.0, 7.0, 8.0]


@pytest.mark.parametrize("part", ["measured", "answers"])
def test_a_damaged_entry_is_none(trusting, stored, rules, tmp_path, part):
    cache = tmp_path / "cache"
    (ref,) = discover(stored)
    truth = score_episode(ref, rules, cache=cache)
    file = CacheFolder(cache).file(ref, part)
    whole = file.read_bytes()
    for kept in range(0, len(whole), max(1, len(whole) // 40)):
        file.write_bytes(whole[:kept])
        assert score_episode(ref, rules, cache=cache) == truth
    for place in range(0, len(whole), max(1, len(whole) // 40)):
        file.write_bytes(whole[:place] + bytes([whole[place] ^ 0x55]) + whole[place + 1 :])
        assert score_episode(ref, rules, cache=cache) == truth
    shutil.rmtree(cache)
    assert score_episode(ref, rules, cache=cache) == truth


def test_a_folder_that_cannot_be_written_to_costs_only_time(stored, rules, tmp_path):
    cache = tmp_path / "cache"
    cache.write_text("a file stands here", "utf-8")
    (ref,) = discover(stored)
    assert score_episode(ref, rules, cache=cache) == score_episode(ref, rules)


def test_several_processes_share_a_folder(tmp_path):
    script = (
        "import sys; from safestage_eval.run.score_many import score_paths\n"
        "for value in sys.argv[3:]:\n"
        "    s = score_paths([sys.argv[1]], ['fsh'], overrides={'edge': value}, jobs=1,"
        " cache=sys.argv[2])\n"
        "    print([(r.episode_id, [v.verdict for v in r.verdicts]) for r in s.results])"
    )
    values = ["1 cm", "2 cm", "4 cm", "8 cm"]
    runs = [
        subprocess.Popen(
            [sys.executable, "-c", script, str(TRACES), str(tmp_path), *order],
            stdout=subprocess.PIPE, text=True,
        )
        for order in (values, values[::-1])
    ]  # fmt: skip
    listed = [run.communicate(timeout=300)[0].splitlines() for run in runs]
    truth = []
    for value in values:
        scores = score_paths([TRACES], ["fsh"], overrides={"edge": value}, jobs=1)
        truth.append(str([(r.episode_id, [v.verdict for v in r.verdicts]) for r in scores.results]))
    assert listed == [truth, truth[::-1]]
    assert not list(tmp_path.rglob("*.part"))


def test_pruning_leaves_what_was_used_last(trusting, tmp_path):
    refs, rules = discover(TRACES)[:3], load_rules(["fsh"])
    for ref in refs:
        score_episode(ref, rules, cache=tmp_path)
    folder = CacheFolder(tmp_path)
    for age, ref in enumerate(refs):
        for part in ("measured", "answers"):
            os.utime(folder.file(ref, part), (1000 - age, 1000 - age))
    score_episode(refs[2], rules, cache=tmp_path)  # the oldest is used again
    sizes = {ref.episode_id: folder.file(ref, "measured").stat().st_size for ref in refs}
    judged = sum(folder.file(ref, "answers").stat().st_size for ref in refs)
    kept = CacheFolder(
        tmp_path, most=sizes[refs[0].episode_id] + sizes[refs[2].episode_id] + judged
    )
    assert kept.prune() > 0
    assert not folder.file(refs[1], "measured").exists()
    assert folder.file(refs[2], "measured").exists()
