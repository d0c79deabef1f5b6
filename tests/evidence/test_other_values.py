"""Re-judging under other values from the cache gives what the trace gives, for every parameter."""

import sys
from pathlib import Path

import pytest

from safestage_eval.evidence import answer_log, disk_store
from safestage_eval.formats import EpisodeRef, discover
from safestage_eval.rules import load_rules
from safestage_eval.rules.digest import parameters_read
from safestage_eval.rules.syntax import Quantity
from safestage_eval.run.score_episode import score_episode

CHECKOUT = Path(__file__).parents[2]
sys.path.append(str(CHECKOUT / "benchmarks"))

import made  # noqa: E402

STAGES = ("ISH", "ETS", "FSH")
SHARES = (-0.4, 0.3, 0.9, 4.0)
"""Other values of a parameter, as shares of its own."""


@pytest.fixture(autouse=True)
def trusting(monkeypatch):
    """Files count as settled at once, so that those a test has just written can be remembered."""
    monkeypatch.setattr(disk_store, "RACY", 0)


@pytest.fixture(scope="module")
def episodes(tmp_path_factory):
    """A made episode per stage, of 5 s."""
    folder = tmp_path_factory.mktemp("made")
    size = made.Size(frames=600, vertices=24)
    return {stage: made.write(folder / stage, stage, size) for stage in STAGES}


def others(rules):
    """Parameters that some rule reads, each under other values, as written."""
    read = frozenset().union(*(parameters_read(rules, rule) for rule in rules.rules.values()))
    for name in sorted(read):
        value = rules.params[name]
        base = value.value if isinstance(value, Quantity) else value.amount
        unit = value.text.split()[1]
        scale = float(value.text.split()[0]) / base if base else 1.0
        for share in SHARES:
            other = share * base * scale
            if isinstance(value, Quantity):
                yield name, f"{other:.6g} {unit}"
            elif share > 0:
                yield (
                    name,
                    f"{max(1, round(other))} frames" if "frame" in unit else f"{other:.6g} s",
                )


def test_a_log_that_grew_too_long_keeps_what_is_used(episodes, tmp_path, monkeypatch):
    rules, ref = load_rules(["ets"]), episodes["ETS"]
    score_episode(ref, rules, assigned_only=True, cache=tmp_path)
    monkeypatch.setattr(answer_log, "MOST", 0)  # begun anew each time
    values = [{"min_clearance": f"{value} cm"} for value in (3, 4, 3.5)]
    truth = [score_episode(ref, rules, value, assigned_only=True) for value in values]
    forbid_opening(monkeypatch)
    found = [score_episode(ref, rules, v, assigned_only=True, cache=tmp_path) for v in values]
    assert found == truth


def test_what_a_value_did_to_warnings_stays_with_it(episodes, tmp_path):
    rules, ref = load_rules(["fsh"]), episodes["FSH"]
    for values in ({"contact_force": "5 N"}, {"edge": "3 cm"}, {"contact_force": "6 N"}):
        truth = score_episode(ref, rules, values, assigned_only=True)
        assert bool(truth.notes) == ("contact_force" in values)
        assert score_episode(ref, rules, values, assigned_only=True, cache=tmp_path) == truth


def forbid_opening(monkeypatch):
    def refuse(self, **_):
        raise AssertionError("the trace was opened")

    monkeypatch.setattr(EpisodeRef, "open", refuse)


@pytest.mark.parametrize("stage", STAGES)
@pytest.mark.parametrize(
    "assigned", [True, pytest.param(False, marks=pytest.mark.slow)], ids=["assigned", "all"]
)
def test_every_parameter_under_other_values(episodes, stage, assigned, tmp_path):
    rules, ref = load_rules([stage.lower()]), episodes[stage]
    asked = list(others(rules))
    asked = asked[:: 9 if assigned else 3]
    score_episode(ref, rules, assigned_only=assigned, cache=tmp_path)
    for name, text in asked:
        truth = score_episode(ref, rules, {name: text}, assigned_only=assigned)
        found = score_episode(ref, rules, {name: text}, assigned_only=assigned, cache=tmp_path)
        assert found == truth, (name, text)


def test_stored_episodes_under_other_values(tmp_path):
    rules, refs = load_rules(["ish", "ets", "fsh"]), discover(CHECKOUT / "traces")
    values = [{"commit_lift": "4 mm"}, {"min_clearance": "4 cm"}, {"edge": "6 cm"}]
    values += [{"nudge": "2 mm"}, {"commit_for": "1 s"}, {"stance": "2 cm", "upright": "2 deg"}]
    for number, ref in enumerate(refs[::6]):
        score_episode(ref, rules, assigned_only=True, cache=tmp_path)
        for changed in values[number % 2 :: 2]:
            truth = score_episode(ref, rules, changed, assigned_only=True)
            assert score_episode(ref, rules, changed, assigned_only=True, cache=tmp_path) == truth


@pytest.mark.parametrize(
    ("stage", "name"),
    [("ETS", "min_clearance"), ("FSH", "edge")],  # of ISH dependence is asked anew
)
def test_other_limits_need_nothing_of_the_trace(episodes, stage, name, tmp_path, monkeypatch):
    rules, ref = load_rules([stage.lower()]), episodes[stage]
    values = [{name: f"{value} cm"} for value in (0.5, 1, 3, 5, 9)]
    truth = [score_episode(ref, rules, value, assigned_only=True) for value in values]
    score_episode(ref, rules, assigned_only=True, cache=tmp_path)
    forbid_opening(monkeypatch)
    found = [score_episode(ref, rules, v, assigned_only=True, cache=tmp_path) for v in values]
    assert found == truth


def test_an_entry_of_a_full_episode_stays_small(episodes, tmp_path):
    for stage, ref in episodes.items():
        score_episode(ref, load_rules([stage.lower()]), cache=tmp_path)
    per_frame = sum(path.stat().st_size for path in tmp_path.rglob("*.*")) / 3 / 600
    # a third of it is what touches did to 18 bystanders, each with obstacle and hand (ETS106, ETS107)
    assert per_frame * 8000 < 9e6
