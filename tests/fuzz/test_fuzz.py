"""Hostile inputs end in a verdict that stands, or in words; ``make fuzz`` tries many more."""

import shutil
from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest
from oracle import Sound, difference, held, sound
from outcome import compared, unchanged, weakened
from sampled import ALL
from seeds import recorded, rules
from targets import TARGETS, attempt

from safestage_eval.episode import Track
from safestage_eval.errors import InputError
from safestage_eval.formats import discover, save
from safestage_eval.run.score_episode import score_episode
from safestage_eval.verdicts.problem import Problem

SEED = 1
CORPUS = sorted(path for path in Path(__file__).with_name("corpus").iterdir())

INPUTS = 400 if ALL else 12
"""Of each format."""


@pytest.mark.parametrize("key", TARGETS)
def test_hostile_inputs(tmp_path, key):
    target = TARGETS[key](tmp_path)
    if hasattr(
        target, "again"
    ):  # what is altered when a file is written again is all that is wrong
        assert {outcome.kind for outcome in target.again()} == {"same"}
    kinds = Counter()
    for number in range(INPUTS):
        outcome = attempt(target, number, SEED)
        again = f"python benchmarks/fuzz.py {key} --seed {SEED} --only {number}"
        assert not outcome.bad, f"{again}: {outcome}"
        kinds[outcome.kind] += 1
    assert kinds["problem"] > kinds.total() / 20


def test_the_oracle_tells_what_breaks_the_law():
    truth = {"A": "violation", "B": "pass", "C": "inconclusive"}

    def now(**other):
        return {**truth, **other}

    assert unchanged(truth, truth, "").kind == "same"
    assert unchanged(truth, now(B="inconclusive"), "").kind == "changed"
    assert unchanged(truth, now(A="pass"), "").kind == "false pass"
    assert compared(truth, now(B="inconclusive"), "").kind == "unknown"
    assert compared(truth, now(B="violation"), "").kind == "changed"
    assert weakened(truth, now(B="inconclusive", A="inconclusive"), "").kind == "unknown"
    assert weakened(truth, now(B="not_applicable"), "").kind == "unknown"
    assert weakened(truth, now(C="pass"), "").kind == "false pass"
    assert weakened(truth, {"B": "pass", "C": "inconclusive"}, "").kind == "false pass"
    assert weakened(truth, now(B="violation"), "").kind == "changed"


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    """A recorded episode in a file, and what the oracle knows of it."""
    path = tmp_path_factory.mktemp("stored") / "a.mcap"
    save(recorded()[1], path)
    return path, sound(path, rules())


def test_the_oracle_tells_what_a_trace_lost_or_gained(stored):
    whole = stored[1].episode
    assert not vars(difference(whole, whole))["lost"]
    track = Track(**whole.tracks["bottle"].columns)
    for value, part in ((float("nan"), "lost"), (1.0, "hashed")):
        position = track.position.copy()
        position[3:9] = value
        other = replace(whole, tracks={**whole.tracks, "bottle": replace(track, position=position)})
        result = vars(difference(whole, other))
        assert result.pop(part) == ["bottle.position"]
        assert not any(result.values())
    roles = replace(whole, header=whole.header.model_copy(update={"roles": {}, "policy": "x"}))
    assert difference(whole, roles).lost == ["roles"]
    lie = replace(whole, header=whole.header.model_copy(update={"success": False}))
    assert difference(whole, lie).said


def test_a_changed_value_under_the_sound_hash_must_be_noticed(stored):
    """Where a file vouches for its content, another verdict is no lie, but a breach."""
    path, known = stored
    (ref,) = discover(path)
    track = Track(**known.episode.tracks["bottle"].columns)
    moved = replace(track, position=track.position + 1)
    other = replace(known.episode, tracks={**known.episode.tracks, "bottle": moved})
    turned = dict.fromkeys(known.verdicts, "pass")
    outcome = held(known, ref, other, turned, "", damage=False)
    assert outcome.kind == "false pass"
    unvouched = Sound(known.episode, known.verdicts, None)
    assert held(unvouched, ref, other, turned, "", damage=False).kind == "lie"


@pytest.mark.parametrize("path", CORPUS, ids=lambda path: path.name)
def test_what_was_found_once_is_reported_in_words(tmp_path, path):
    copy = tmp_path / path.name
    if path.is_dir():
        shutil.copytree(path, copy)
    else:
        shutil.copy(path, copy)
    try:
        (ref,) = discover(copy)
        result = score_episode(ref, rules())
    except InputError:
        return
    assert not isinstance(result, Problem) or "cannot be judged" not in result.message
