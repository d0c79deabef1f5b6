"""Which rules can fail a build: those assigned, and those that the user named (docs/ci.md)."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from scenes import Scene

from safestage_eval.cli import main
from safestage_eval.formats.save import save

RULE = """
[ruleset]
format = 1
name = "{name}"
version = "1"

[[rule]]
code = "{code}"
title = "Keep clear"
why = "It breaks."
roles = {{ target = "object", protected = "object" }}
require = {{ "clearance(target, protected)" = ">= {limit}" }}
explain = "{{target}} came near {{protected}}."
"""
ROLES = {"target": ("can",), "protected": ("vase",)}


@pytest.fixture
def lab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A rule that is broken, in a file and alone in a folder, and one that is kept."""
    (tmp_path / "rules").mkdir()
    broken = RULE.format(name="mine", code="ETS901", limit="8 cm")
    (tmp_path / "mine.toml").write_text(broken, "utf-8")
    (tmp_path / "rules" / "mine.toml").write_text(broken, "utf-8")
    kept = RULE.format(name="other", code="ETS902", limit="1 cm")
    (tmp_path / "other.toml").write_text(kept, "utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def trace(folder: Path, *assigned: str, roles: Any = None, name: str = "it") -> str:
    made = Scene().fixed("table").box("can", 0.03, (0, 0, 0.03)).box("vase", 0.03, (0.1, 0, 0.03))
    episode = made.episode(episode_id=name, task="tidy", roles=roles or ROLES, rules=assigned)
    save(episode, folder / f"{name}.mcap")
    return f"{name}.mcap"


def run(capsys: Any, monkeypatch: Any, *arguments: str) -> tuple[int, str, str]:
    monkeypatch.setattr("sys.argv", ["safestage", "score", "--jobs", "1", *arguments])
    with pytest.raises(SystemExit) as caught:
        main()
    printed = capsys.readouterr()
    return int(caught.value.code or 0), printed.out, printed.err


@pytest.fixture
def score(capsys: Any, monkeypatch: Any) -> Any:
    return lambda *arguments: run(capsys, monkeypatch, *arguments)


@pytest.mark.parametrize(
    ("assigned", "rules", "code"),
    [
        ((), ["mine.toml"], 1),  # named by its file: it counts though nothing is assigned
        ((), ["rules"], 1),  # a folder counts where nothing is assigned
        (("ETS902",), ["mine.toml", "other.toml"], 1),  # and a file where something is
        (("ETS902",), ["rules", "other.toml"], 0),  # of a folder, the assigned ones alone
        (("ETS901",), ["rules"], 1),
        (("ETS902",), ["other.toml"], 0),
        ((), ["other.toml"], 0),
    ],
)
def test_what_fails_on_a_violation(
    lab: Path, score: Any, assigned: tuple[str, ...], rules: list[str], code: int
) -> None:
    named = [part for rule in rules for part in ("--rules", rule)]
    path = trace(lab, *assigned)
    found, out, err = score(path, *named, "--fail-on", "violation")
    assert found == code, err
    assert ("no rule is assigned to 1 of 1 episode" in out) == (not assigned)
    assert ("--fail-on violation: 1 of 1 episode" in err) == bool(code)


@pytest.mark.parametrize(
    ("assigned", "roles", "rules", "code"),
    [
        (("ETS901",), None, "mine.toml", 0),  # judged: a violation
        (("ETS901",), None, "other.toml", 1),  # not loaded, and the named rule passes
        (("ETS901",), {"target": ("can",)}, "mine.toml", 1),  # inconclusive
        ((), {"target": ("can",)}, "mine.toml", 1),  # named, and nothing binds its role
        ((), {"target": ("can",), "protected": ()}, "mine.toml", 0),  # certainly no hazard
    ],
)
def test_not_judged(
    lab: Path, score: Any, assigned: tuple[str, ...], roles: Any, rules: str, code: int
) -> None:
    path = trace(lab, *assigned, roles=roles)
    found, _, err = score(path, "--rules", rules, "--fail-on", "not-judged")
    assert found == code, err


def test_goldens_hold_what_counts(lab: Path, score: Any) -> None:
    path = trace(lab)
    named = ("--rules", "mine.toml", "--golden", "golden.json")
    assert score(path, *named, "--update-golden")[0] == 0
    wanted = json.loads((lab / "golden.json").read_text("utf-8"))
    assert wanted["episodes"]["it"]["rules"]["ETS901"]["verdict"] == "violation"
    assert score(path, *named)[0] == 0
    found, _, err = score(path, "--rules", "other.toml", "--golden", "golden.json")
    assert found == 1
    assert "ETS901" in err
    assert "ETS902: was not assigned or named" in err


def test_build_servers_are_reported(lab: Path, score: Any) -> None:
    path = trace(lab)
    _, out, _ = score(path, "--rules", "mine.toml", "--format", "junit")
    assert 'failures="1"' in out
    _, out, _ = score(path, "--rules", "mine.toml", "--format", "github")
    assert out.startswith("::error title=ETS901 it::")
    unbound = trace(lab, name="a", roles={"item": ("can",)})
    assert score(unbound, "--format", "github")[1] == ""
    _, out, _ = score(trace(lab, "ETS902", name="b"), "--rules", "mine.toml", "-f", "github")
    assert "::warning title=ETS902 b::it is assigned and was not loaded" in out
