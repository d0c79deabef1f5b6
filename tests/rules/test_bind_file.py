"""Bind files: what a trace's header lacks, said beside it."""

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from scenes import G, Scene

from safestage_eval.cli.score_command import command
from safestage_eval.formats import save
from safestage_eval.report.episode_report import explain
from safestage_eval.rules import RuleErrors, bind_episode, load_bind, load_rules
from safestage_eval.verdicts import judge

RULES = load_rules(["ish", "ets", "fsh", "goals"])
TASK = """
[task.tea]
roles = { target = "t", protected = ["p"] }
rules = ["ETS201"]
set = { min_clearance = "12 cm" }
"""


def unlabelled(name: str = "e1", task: str | None = "tea"):
    """A hand pushes a box up to 2 cm from another; nothing says which is which."""
    frames = 240
    x = np.clip((np.arange(frames) - 12) / 120 * 0.4, 0, 0.38)
    scene = Scene(frames).fixed("table").box("p", 0.05, (0.5, 0, 0.05))
    scene.box("t", 0.05, np.column_stack([x, 0 * x, 0 * x + 0.05]))
    scene.box("hand", 0.02, np.column_stack([x - 0.07, 0 * x, 0 * x + 0.05]), kind="gripper")
    for i in range(frames):
        scene.contact("hand", "t", (x[i] - 0.05, 0, 0.05), (2, 0, 0), (1, 0, 0), slice(i, i + 1))
    scene.rests("p", "table", 0.05, (0.5, 0, 0), G).rests("t", "table", 0.05, (0, 0, 0), G)
    return scene.episode(episode_id=name, task=task, policy="pi0")


def bound(text: str, tmp_path: Path):
    file = tmp_path / "labels.toml"
    file.write_text(text, "utf-8")
    return load_bind(file, RULES)


def test_roles_rules_and_values_are_bound_and_say_whence(tmp_path: Path) -> None:
    bare = judge(unlabelled(), RULES)
    assert (bare.violation, bare.assigned) == (None, ())
    result = judge(unlabelled(), RULES, bind=bound(TASK, tmp_path))
    assert result.violation is True
    (verdict,) = result.assigned
    assert verdict.rule == "ETS201"
    assert verdict.limit == pytest.approx(0.12)
    assert verdict.sources == (
        "target = t: bind file",
        "protected = p: bind file",
        "min_clearance = 12 cm: bind file",
        "assigned: bind file",
    )
    assert "bound: target = t: bind file; protected = p" in explain(result, everything=True)
    (row,) = (row for row in result.rows() if row["rule"] == "ETS201")
    assert row["sources"] == list(verdict.sources)


def test_a_goal_by_name_or_as_a_table(tmp_path: Path) -> None:
    table = """
[task.tea]
roles = { target = "t" }
[task.tea.goal]
roles = { target = "object" }
require = { "displacement(target)" = ">= 30 cm" }
"""
    blank = unlabelled()
    for text, success in [(table, True), (table.replace("30 cm", "3 m"), False)]:
        header = blank.header.model_copy(update={"success": None})
        episode = type(blank)(header, blank.t, blank.tracks, blank.contacts, blank.frames)
        assert judge(episode, RULES, bind=bound(text, tmp_path)).success is success
    named = bound('[task.tea]\ngoal = "on"', tmp_path)
    binding = bind_episode(RULES, blank.header, bind=named)
    assert binding.goal == RULES.goals["on"]
    assert binding.provenance["goal"] == "bind file"


@pytest.mark.parametrize(
    ("text", "code", "line", "column", "words"),
    [
        ('[task.tea]\nrole = { target = "t" }', "R201", 2, 1, 'did you mean "roles"'),
        ("[tasks.tea]\nroles = {}", "R201", 1, 2, 'did you mean "task"'),
        ('[task.tea]\nroles = { target = 5 }', "R203", 2, 20, "played by one body"),
        ('[task.tea]\nroles = "t"', "R203", 2, 9, "wrong type"),
        ('[task.tea]\nrules = ["ETS20"]', "R203", 2, 10, "not a code"),
        ('[task.tea]\nset = { min_clearence = "3 cm" }', "R408", 2, 9, "min_clearance"),
        ('[task.tea]\nset = { min_clearance = "3 deg" }', "R407", 2, 25, "an angle"),
        ("[task.tea]\ngoal = 3", "R203", 2, 8, "wrong type"),
        ('[task.tea.goal]\nrequire = { "heigt(x)" = ">= 1 m" }', "R401", 2, 14, "height"),
        ("[body.x]\nup = [0, 0]", "R203", 2, 6, "or false"),
        ("[body.x]\nup = true", "R203", 2, 6, "or false"),
        ('[body.x]\nfinger = "middle"', "R203", 2, 10, "left"),
        ("[body.x]\ntag = []", "R201", 2, 1, 'did you mean "tags"'),
        ("[evry]", "R201", 1, 1, 'did you mean "every"'),
        ("[every]\nrole = {}", "R201", 2, 1, 'did you mean "roles"'),
        ("task = 5", "R203", 1, 8, "must be a table"),
        ("[task.tea\n", "R102", 1, 10, "TOML"),
    ],
)  # fmt: skip
def test_mistakes_are_shown_where_they_stand(text, code, line, column, words, tmp_path) -> None:
    with pytest.raises(RuleErrors) as caught:
        bound(text, tmp_path)
    first = caught.value.diagnostics[0]
    assert (first.code, first.line, first.column) == (code, line, column), first.render()
    assert words in first.render()


BODIES = """
[every]
roles = { target = "t" }
rules = ["ETS105"]
[body."?"]
tags = ["fragile"]
up = [0, 0, 2]
[body.t]
tags = ["heavy"]
up = false
"""


def test_bodies_are_described_by_name_or_pattern(tmp_path: Path) -> None:
    file, episode = bound(BODIES, tmp_path), unlabelled()
    values = {body.name: body for body in file.described(episode).header.bodies}
    assert (values["p"].tags, values["p"].up_axis) == (("fragile",), (0.0, 0.0, 1.0))
    assert (values["t"].tags, values["t"].up_axis) == (("heavy",), None)
    assert values["table"] == episode.bodies["table"]
    result = judge(episode, RULES, bind=file)
    assert result.assigned[0].vacuity is None  # p is fragile now
    bare = judge(episode, RULES, bind=bound(BODIES.partition("[body")[0], tmp_path))
    assert bare.assigned[0].vacuity == "no_player"
    assert result.trace_hash == bare.trace_hash == episode.content_hash


# ---- from the command line, from a notebook, in several processes


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("traces")
    for name in ("e1", "e2"):
        save(unlabelled(name), folder / f"{name}.mcap")
    return folder


def test_from_the_command_line(stored: Path, tmp_path: Path) -> None:
    file = tmp_path / "labels.toml"
    file.write_text(TASK, "utf-8")
    run = CliRunner().invoke(
        command, [str(stored), "-r", "ets", "--bind", str(file), "-f", "csv", "-j", "1"]
    )
    assert run.exit_code == 0, run.output
    assert run.output.count("ETS201,true,violation") == 2
