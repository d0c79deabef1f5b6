"""docs/tasks.md: its task file is one, its policy runs; the page of skills has every argument."""

from __future__ import annotations

import inspect
import re
import sys
from pathlib import Path

import pytest

from safestage_eval.formats import load
from simulate.feasibility.feasibility import cases, trials
from simulate.skills import SKILLS
from simulate.tasks.task import read_task

pytestmark = pytest.mark.simulate

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "docs" / "site"))

from skill_page import skills_page  # noqa: E402

PAGE = (ROOT / "docs" / "tasks.md").read_text("utf-8")


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


def test_every_argument_of_a_skill_is_described() -> None:
    for name, text in re.findall(r"^## `(\w+)`\n(.*?)(?=^## |\Z)", skills_page(), re.M | re.S):
        rows = re.findall(r"^\| `(\w+)` \|.*\| (\S.*) \|$", text, re.MULTILINE)
        said = [argument for argument, _ in rows]
        assert said == [*inspect.signature(SKILLS[name]).parameters][1:]
