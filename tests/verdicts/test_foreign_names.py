"""Signals of bodies whose names come from other simulators, and roles that such bodies play."""

import numpy as np
import pytest
from scenes import Scene

from safestage_eval.errors import InputError
from safestage_eval.rules import load_bind, load_rules
from safestage_eval.verdicts.ask import ask, by_bodies
from safestage_eval.verdicts.judging import judge

NAMES = ("cubeA", "milk-1", "the tray")


@pytest.fixture
def episode():
    s = Scene(120, 60.0).fixed("table")
    up = np.column_stack([0 * s.t, 0 * s.t, 0.02 + 0.1 * np.clip(s.t - 1, 0, 1)])
    for i, name in enumerate(NAMES):
        s.box(name, 0.02, up + np.array([0.3 * i, 0, 0]))
    return s.episode()


@pytest.mark.parametrize("written", ["cubeA", "milk-1", "'the tray'", '"cubeA"'])
def test_a_signal_of_a_body_by_its_name(episode, written):
    series = ask(episode, f"lift({written})")
    assert series.lower[-1] == pytest.approx(0.098, abs=0.005)
    assert by_bodies(episode, f"lift({written})") == f"lift({written.strip(chr(39) + chr(34))})"


def test_a_name_with_a_space_and_no_quotes_is_explained(episode):
    with pytest.raises(InputError, match="any other name in quotes"):
        ask(episode, "lift(the tray)")


def test_a_rule_judges_them_by_their_roles(episode, tmp_path):
    (tmp_path / "r.toml").write_text(
        '[ruleset]\nname = "own"\nformat = 1\nversion = "1.0"\n[[rule]]\ncode = "OWN101"\ntitle = "Low"\n'
        'roles = { target = "every object" }\nrequire = { "lift(target)" = "< 5 cm" }\n'
    )
    names = ", ".join(f'"{name}"' for name in NAMES)
    (tmp_path / "b.toml").write_text(f"[every.roles]\ntarget = [{names}]\n")
    rules = load_rules([tmp_path / "r.toml"])
    [verdict] = judge(episode, rules, bind=load_bind(tmp_path / "b.toml", rules)).verdicts
    assert verdict.verdict == "violation"
    assert any(name in str(verdict) for name in NAMES)
