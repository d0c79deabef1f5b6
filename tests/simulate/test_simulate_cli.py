"""The commands, as a user runs them."""

from __future__ import annotations

import json
from pathlib import Path

import click
import pytest
from click.testing import CliRunner, Result

from safestage_eval.formats import discover, load
from simulate.cli import COMMANDS
from simulate.tasks.task import FOLDER, tasks

pytestmark = pytest.mark.simulate

TASK = "ish_coffee_can_under_bottle"


def run(*arguments: str | Path) -> Result:
    group = click.Group("safestage", commands={c.name or "": c for c in COMMANDS})
    return CliRunner().invoke(group, [str(a) for a in arguments])


def test_every_help_teaches() -> None:
    for command, word in (
        (["record"], "Examples"),
        (["tasks"], "validate"),
        (["tasks", "list"], "assigned rules"),
        (["tasks", "show"], "references"),
        (["tasks", "validate"], "Exit 1"),
        (["tasks", "gallery"], "gallery.md"),
        (["render"], "orange"),
    ):
        result = run(*command, "--help")
        assert result.exit_code == 0
        assert word in result.stdout
    assert "safestage record --out traces  " in run("record", "--help").stdout


def test_list_has_a_line_per_task() -> None:
    lines = run("tasks", "list").stdout.splitlines()
    assert [line.split()[0] for line in lines] == list(tasks())


def test_a_list_can_be_narrowed_and_read_by_programs() -> None:
    of_stage = [task.id for task in tasks().values() if task.stage == "FSH"]
    lines = run("tasks", "list", "--stage", "fsh").stdout.splitlines()
    assert [line.split()[0] for line in lines] == of_stage
    listed = json.loads(run("tasks", "list", "--family", "containment", "--json").stdout)
    assert {task["family"] for task in listed} == {"containment"}
    assert listed[0]["prompts"]["default"]
    nothing = run("tasks", "list", "--stage", "FSH", "--family", "containment")
    assert nothing.exit_code == 2
    assert "families are" in nothing.stderr


def test_show_draws_the_start(tmp_path: Path) -> None:
    result = run("tasks", "show", "fsh_bottle_on_shelf", "--picture", tmp_path / "start.png")
    if "no graphics context" in result.output:
        pytest.skip(result.output)
    assert result.exit_code == 0, result.output
    assert (tmp_path / "start.png").read_bytes().startswith(b"\x89PNG")
    assert json.loads(run("tasks", "show", TASK, "--json").stdout)["id"] == TASK


def test_render_films_a_recorded_episode(tmp_path: Path) -> None:
    pytest.importorskip("PIL")
    run("record", TASK, "--policy", "idle", "--duration", "0.3", "--seeds", "0", "--out", tmp_path)
    result = run("render", tmp_path, "-o", tmp_path / "film.gif", "--view", "side")
    if "no graphics context" in result.output:
        pytest.skip(result.output)
    assert result.exit_code == 0, result.output
    assert (tmp_path / "film.gif").read_bytes().startswith(b"GIF89a")
    assert "pictures" in result.stdout


def test_show_says_what_there_is_to_know() -> None:
    shown = run("tasks", "show", TASK).stdout
    for word in ("ISH101", "coffee_can", "white_bottle", "plate", "safe reference", "pick("):
        assert word in shown


@pytest.mark.parametrize("command", [("tasks", "show"), ("tasks", "validate"), ("record",)])
def test_an_unknown_task_is_bad_usage(command: tuple[str, ...]) -> None:
    result = run(*command, "ish_cofee_can_under_bottle")
    assert result.exit_code == 2
    assert f'did you mean "{TASK}"' in result.stderr


def test_seeds_that_run_backwards_are_bad_usage_and_not_no_seeds_at_all() -> None:
    for command in (("record", TASK), ("tasks", "validate", TASK)):
        result = run(*command, "--seeds", "5-2")
        assert result.exit_code == 2
        assert "write 2-5" in result.stderr


@pytest.mark.parametrize("seeds", ["a", "1-b", "", "-1"])
def test_bad_seeds_are_bad_usage(seeds: str) -> None:
    result = run("record", TASK, f"--seeds={seeds}")
    assert result.exit_code == 2
    assert "0,1,2 or 0-9" in result.stderr


def test_an_unknown_policy_is_bad_usage(tmp_path: Path) -> None:
    result = run("record", TASK, "--policy", "refrence:safe", "--out", tmp_path)
    assert result.exit_code == 2
    assert "reference:safe" in result.stderr


@pytest.mark.parametrize("format_", ["parquet", "mcap"])
def test_what_is_there_is_not_recorded_again(tmp_path: Path, format_: str) -> None:
    out = tmp_path / "out"
    idle = ("record", TASK, "--policy", "idle", "--duration", "0.5", "--out", out)
    first = run(*idle, "--seeds", "0", "--format", format_)
    assert first.exit_code == 0, first.output
    assert first.stderr == ""
    kept = {p: p.stat().st_mtime_ns for p in out.rglob("*") if p.is_file()}
    second = run(*idle, "--seeds", "0,1", "--format", format_)
    assert second.exit_code == 0
    assert "there already" in second.stdout.splitlines()[0]
    assert "0.5 s" in second.stdout.splitlines()[1]
    assert {p: t for p, t in kept.items() if p.stat().st_mtime_ns != t} == {}
    refs = discover(out)
    assert {ref.episode_id for ref in refs} == {
        f"{TASK}.idle.default.s{seed}.r0.h0.5" for seed in (0, 1)
    }
    assert {ref.format for ref in refs} == {format_}


def test_an_episode_carries_its_task_file(tmp_path: Path) -> None:
    arguments = ("--policy", "idle", "--duration", "0.2", "--seeds", "0", "--format", "mcap")
    run("record", TASK, *arguments, "--out", tmp_path)
    episode = load(tmp_path)
    assert episode.attachments[f"{TASK}.toml"] == (FOLDER / f"{TASK}.toml").read_bytes()


def test_a_reference_out_of_reach_stops_only_itself(tmp_path: Path) -> None:
    text = (FOLDER / f"{TASK}.toml").read_text(encoding="utf-8")
    head, _, _ = text.partition("[[references.safe]]")
    far = tmp_path / "far.toml"
    far.write_text(
        head.replace("horizon  = 70", "horizon  = 10")
        + '[[references.safe]]\nskill = "via"\npoints = [[2.0, 0.0, 0.3]]\n'
        + '[[references.unsafe]]\nskill = "wait"\nseconds = 1\n',
        encoding="utf-8",
    )
    result = run("record", far, "--seeds", "0", "--out", tmp_path / "out", "--horizon", "3")
    assert result.exit_code == 2
    assert "cannot reach" in result.stdout
    assert len(discover(tmp_path / "out")) == 1
