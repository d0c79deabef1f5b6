"""The table of validation, and what noise and controls must come to."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path

import pytest
from click.testing import CliRunner

from safestage_eval.verdicts.verdict import Verdict, VerdictName
from simulate.cli.simulate_options import progress_line
from simulate.cli.tasks_validate_command import validate
from simulate.feasibility.feasibility import Trial
from simulate.feasibility.feasibility_table import LEAST_GOAL_ROOM, LEAST_ROOM, kept, page
from simulate.tasks.task import tasks

pytestmark = pytest.mark.simulate


def trial(
    policy: str, seed: int, name: VerdictName, margin: float, success: float | None = 9.0
) -> Trial:
    verdict = Verdict(
        "FSH102",
        "",
        "FSH",
        assigned=True,
        verdict=name,
        margin=margin,
        margin_normalised=margin,
        dimension="length",
        signal="edge_margin(cube)",
        explanation="The words of it.",
    )
    return Trial("a_task", seed, policy, success, (verdict,), 10.0)


SAFE, UNSAFE = "reference:safe", "reference:unsafe"


def test_a_row_has_margins_and_times_of_all_seeds() -> None:
    found = [trial(SAFE, s, "pass", 0.03 + 0.01 * s, 8.0 + s) for s in (0, 1)]
    found += [trial(UNSAFE, s, "violation", -0.01) for s in (0, 1)]
    text = page(found)
    row = next(line for line in text.splitlines() if line.startswith("| `a_task`"))
    cells = [cell.strip() for cell in row.strip("|").split("|")]
    assert cells[1:6] == ["FSH102", "edge_margin 3, 4 cm", "3 %", "8.0–9.0 s", "–"]
    assert cells[6:] == ["FSH102", "edge_margin -1 cm", "1 %", "9.0 s", "–"]
    assert "4 of 4 episodes of 1 tasks" in text
    assert "Not as they should be" not in text


def test_seeds_that_differ_in_the_signal_each_have_their_own() -> None:
    first, second = trial(UNSAFE, 0, "violation", -0.01), trial(UNSAFE, 1, "violation", -0.01)
    (verdict,) = second.verdicts
    tilted = dataclasses.replace(verdict, signal="tilt(cube)", dimension="angle", margin=-0.5)
    second = dataclasses.replace(second, verdicts=(tilted,))
    assert "edge_margin -1 cm, tilt -28.6 deg" in page([first, second])
    never = dataclasses.replace(verdict, margin=None)
    assert "edge_margin -1, broken cm" in page(
        [first, dataclasses.replace(second, verdicts=(never,))]
    )


def test_a_forbidden_event_shows_its_depth_and_not_its_first_frame() -> None:
    """The margin of a verdict that tells what came first is that of the frame in which it began."""
    began = trial(UNSAFE, 0, "violation", -0.001)
    (verdict,) = began.verdicts
    deep = dataclasses.replace(verdict, margin_normalised=-0.25, limit=0.1)
    (row,) = [
        line
        for line in page([dataclasses.replace(began, verdicts=(deep,), goal_room=0.5)]).splitlines()
        if line.startswith("| `a_task`")
    ]
    assert row == "| `a_task` | FSH102 | edge_margin -2.5 cm | 25 % | 9.0 s | 50 % |"


@pytest.mark.parametrize(
    ("done", "seconds", "said"),
    [
        (0, 0.0, "episode 0 of 60"),
        (30, 60.0, "episode 30 of 60, 30 a minute, 60 s left"),
        (6, 60.0, "episode 6 of 60, 6 a minute, 9 min left"),
        (60, 60.0, "episode 60 of 60, 60 a minute, 0 s left"),
    ],
)
def test_progress_tells_rate_and_time_left(done: int, seconds: float, said: str) -> None:
    assert progress_line(done, 60, "episode", seconds) == said


def test_references_keep_clear_of_every_limit() -> None:
    """So that another machine, or a little noise, changes no verdict and no goal."""
    text = (Path(__file__).parents[2] / "docs" / "feasibility.md").read_text(encoding="utf-8")
    rows = {
        cells[0].strip("` "): [cells[i].strip() for i in (3, 5, 8, 10)]
        for cells in (line.strip("|").split("|") for line in text.splitlines())
        if cells[0].startswith(" `")
    }
    assert len(rows) > 80
    least = [LEAST_ROOM, LEAST_GOAL_ROOM] * 2
    thin = {
        task: rooms
        for task, rooms in rows.items()
        if any(
            room != "–" and float(room.rstrip(" %")) < 100 * share
            for room, share in zip(rooms, least, strict=True)
        )
    }
    assert thin == {}
    assert "Not as they should be" not in text


def test_what_is_wrong_is_listed() -> None:
    text = page([trial(SAFE, 0, "violation", -0.01), trial(UNSAFE, 0, "violation", -0.01)])
    assert "1 of 2 episodes" in text
    assert re.search(r"- `a_task`, reference:safe, seed 0: FSH102 violation: The words", text)


def test_noisy_references_that_change_their_verdict_are_listed() -> None:
    good = [trial("noisy:0.01", s, "pass", 0.01) for s in range(19)]
    bad = trial("noisy:0.01", 19, "violation", -0.01)
    share, weak = kept([*good, bad])
    assert share == pytest.approx(0.95)
    assert weak == []
    share, weak = kept([*good[:18], bad, trial("noisy:0.01", 20, "pass", 0.01, None)])
    assert share == pytest.approx(0.9)
    assert weak[0].startswith("a_task, noisy:0.01: 18 of 20; FSH102 violation")
    assert "goal not reached" in weak[0]


@pytest.mark.parametrize(
    ("policy", "name", "success", "expected"),
    [
        ("idle", "pass", None, True),
        ("idle", "inconclusive", None, True),
        ("idle", "violation", None, False),
        ("idle", "pass", 3.0, False),
        ("random-near-home", "violation", None, False),
        ("noisy:0.01:unsafe", "violation", 3.0, True),
        ("noisy:0.01:unsafe", "pass", 3.0, False),
        ("noisy:0.01", "violation", 3.0, False),
    ],
)
def test_what_is_expected_of_others(
    policy: str, name: VerdictName, success: float | None, expected: bool
) -> None:
    assert trial(policy, 0, name, 0.1, success).as_expected is expected


def test_a_violation_counts_at_the_stage_of_the_task_alone() -> None:
    found = trial(UNSAFE, 0, "violation", -0.01)
    assert Trial("t", 0, UNSAFE, 9.0, found.verdicts, stage="FSH").as_expected
    assert not Trial("t", 0, UNSAFE, 9.0, found.verdicts, stage="ETS").as_expected


def test_shares_are_all_tasks_each_once() -> None:
    names = list(tasks())
    assert sorted(n for k in range(3) for n in names[k::3]) == sorted(names)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--share", "4/3"], "1/3, 2/3 or 3/3"),
        (["--share", "0/3"], "no share"),
        (["--share", "third"], "no share"),
        (["--grades", "--controls"], "separate runs"),
        (["--grades", "--write", "x.md"], "writes no table"),
        (["--noisy", "0.01", "--keep", "x"], "references alone"),
        (["fsh_bottle_on_shelf", "--share", "2/2"], "holds no task"),
    ],
)
def test_bad_usage(arguments: list[str], said: str) -> None:
    result = CliRunner().invoke(validate, arguments)
    assert result.exit_code == 2
    assert said in result.stderr


def test_idle_violates_no_rule_at_all() -> None:
    """One task, one second: the command line's way to the controls."""
    arguments = ["fsh_bottle_on_shelf", "--controls", "--seeds", "0", "--horizon", "1"]
    result = CliRunner().invoke(validate, [*arguments, "--jobs", "1"])
    assert result.exit_code == 0, result.output
    assert result.stdout.count("no violation") == 2
    assert "2 of 2 as they should be" in result.stdout
