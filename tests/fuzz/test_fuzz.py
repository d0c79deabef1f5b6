"""Hostile inputs end in a verdict that stands, or in words; benchmarks/fuzz.py tries many more.

Others each day: the seed is the date, and a failure says it.
"""

import shutil
from collections import Counter
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import fuzz
import pytest
from oracle import Sound, difference, held, sound
from outcome import compared, unchanged, weakened
from seeds import recorded, rules
from targets import TARGETS, attempt

from safestage_eval.episode import Track
from safestage_eval.errors import InputError
from safestage_eval.formats import discover, save
from safestage_eval.run.score_episode import score_episode
from safestage_eval.verdicts.problem import Problem

SEED = datetime.now(UTC).toordinal()
CORPUS = sorted(path for path in Path(__file__).with_name("corpus").iterdir())

FEW = {
    "parquet": 25,
    "mcap": 40,
    "zip": 40,
    "robolab": 25,
    "maniskill": 30,
    "lerobot": 40,
    "rlds": 40,
    "calvin": 20,
    "ros": 30,
    "sqlite": 30,
    "foxglove": 40,
    "mujoco": 40,
    "rules": 60,
    "bind": 60,
    "map": 60,
    "tables": 60,
}
"""Inputs of each format by default; the slow tests take the next three times as many."""


@pytest.mark.parametrize("key", FEW)
@pytest.mark.parametrize("many", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_hostile_inputs(tmp_path, key, many):
    target = TARGETS[key](tmp_path)
    few = FEW[key]
    numbers = range(few, 4 * few) if many else range(few)
    outcomes = {number: attempt(target, number, SEED) for number in numbers}
    bad = {number: outcome for number, outcome in outcomes.items() if outcome.bad}
    assert not bad, f"python benchmarks/fuzz.py {key} --seed {SEED} --only {min(bad)}: {bad}"
    assert sum(outcome.kind == "problem" for outcome in outcomes.values()) > few / 10


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


def test_a_row_of_the_page_stays_until_as_many_inputs_were_tried(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(f"before {fuzz.MARKS[0]}\n{fuzz.MARKS[1]} after\n", "utf-8")

    def tried(seed, inputs):
        return fuzz.Tally(Counter(problem=inputs - 1, lie=1), seconds=1.0, done=[[seed, 0, inputs]])

    def rows(**tallies):
        fuzz.write(page, tallies)
        text = page.read_text("utf-8")
        assert text.startswith("before <!--")
        assert text.endswith("--> after\n")
        lines = [line for line in text.splitlines() if line.startswith("|")][2:]
        cells = [[cell.strip() for cell in line.split("|")[1:-1]] for line in lines]
        assert all(len(row) == len(fuzz.HEAD) for row in cells)
        return [(row[0], row[1], row[-2]) for row in cells]

    zipped, rule = (TARGETS[key].name for key in ("zip", "rules"))
    assert rows(zip=tried(1, 2000), rules=tried(1, 50)) == [
        (zipped, "2,000", "1"),
        (rule, "50", "1"),
    ]
    assert rows(zip=tried(2, 300)) == [
        (zipped, "2,000", "1"),
        (zipped, "300", "2"),
        (rule, "50", "1"),
    ]
    assert rows(zip=tried(2, 2000), mcap=fuzz.Tally()) == [
        (zipped, "2,000", "2"),
        (rule, "50", "1"),
    ]
