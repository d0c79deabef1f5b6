"""docs/tasks.md: its task file is one, its policy runs, its table of skills is complete."""

from __future__ import annotations

import inspect
import re
from pathlib import Path

import pytest

from safestage_eval.formats import load
from simulate.feasibility.feasibility import cases, trials
from simulate.skills import SKILLS
from simulate.tasks.task import read_task

pytestmark = pytest.mark.simulate

PAGE = (Path(__file__).parents[2] / "docs" / "tasks.md").read_text("utf-8")


def block(language: str) -> str:
    found = re.search(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)
    assert found is not None
    return found[1]


def test_the_example_task_is_feasible(tmp_path: Path) -> None:
    file = tmp_path / "fsh_cube_on_mat.toml"
    file.write_text(block("toml"), "utf-8")
    for trial in trials(cases([read_task(file)], [0])):
        assert trial.as_expected, trial


def test_the_example_policy_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    exec(block("python"), {"__name__": "example"})
    episode = load("waver.mcap")
    assert episode.header.policy == "waver"
    assert len(episode) == 240


def test_every_skill_and_argument_is_in_the_table() -> None:
    for name in SKILLS:
        row = re.search(rf"^\| `{name}` \| (.*?) \|", PAGE, re.MULTILINE)
        assert row is not None, name
        said = re.findall(r"`(\w+)`", row[1])
        assert said == [*inspect.signature(SKILLS[name]).parameters][1:]
