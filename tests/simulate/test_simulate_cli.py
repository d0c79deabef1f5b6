"""The commands, as a user runs them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from studio import run

from safestage_eval.formats import discover
from simulate.tasks.task import FOLDER, tasks

pytestmark = pytest.mark.simulate

TASK = "ish_coffee_can_under_bottle"


def test_list_has_a_line_per_task() -> None:
    lines = run("bench", "tasks", "list").text.splitlines()
    assert [line.split()[0] for line in lines] == list(tasks())


def test_show_draws_the_start(tmp_path: Path) -> None:
    result = run(
        "bench", "tasks", "show", "fsh_bottle_on_shelf", "--picture", tmp_path / "start.png"
    )
    if "no graphics context" in result.err:
        pytest.skip(result.err)
    assert result.code == 0, result.err
    assert (tmp_path / "start.png").read_bytes().startswith(b"\x89PNG")
    assert json.loads(run("bench", "tasks", "show", TASK, "--json").text)["id"] == TASK


def test_render_films_a_recorded_episode(tmp_path: Path) -> None:
    pytest.importorskip("PIL")
    recorded = tmp_path / "recorded"
    record = ("bench", "record", TASK, "--policy", "idle", "--duration", "0.3", "--seeds", "0")
    run(*record, "--out", recorded)
    result = run("plot", "film", recorded, "-o", tmp_path / "film.gif", "--view", "side")
    if "no graphics context" in result.err:
        pytest.skip(result.err)
    assert result.code == 0, result.err
    assert (tmp_path / "film.gif").read_bytes().startswith(b"GIF89a")
    assert "pictures" in result.text


@pytest.mark.parametrize(
    "command", [("bench", "tasks", "show"), ("bench", "tasks", "validate"), ("bench", "record")]
)
def test_an_unknown_task_is_bad_usage(command: tuple[str, ...]) -> None:
    result = run(*command, "ish_cofee_can_under_bottle")
    assert result.code == 2
    assert f'did you mean "{TASK}"' in result.err


@pytest.mark.parametrize("seeds", ["a", "1-b", "", "-1"])
def test_bad_seeds_are_bad_usage(seeds: str) -> None:
    result = run("bench", "record", TASK, f"--seeds={seeds}")
    assert result.code == 2
    assert "0,1,2 or 0-9" in result.err


@pytest.mark.parametrize("format_", ["parquet", "mcap"])
def test_what_is_there_is_not_recorded_again(tmp_path: Path, format_: str) -> None:
    out = tmp_path / "out"
    idle = ("bench", "record", TASK, "--policy", "idle", "--duration", "0.5", "--out", out)
    first = run(*idle, "--seeds", "0", "--format", format_)
    assert first.code == 0, first.err
    assert first.err == ""
    kept = {p: p.stat().st_mtime_ns for p in out.rglob("*") if p.is_file()}
    second = run(*idle, "--seeds", "0,1", "--format", format_)
    assert second.code == 0
    assert "there already" in second.text.splitlines()[0]
    assert "0.5 s" in second.text.splitlines()[1]
    assert {p: t for p, t in kept.items() if p.stat().st_mtime_ns != t} == {}
    refs = discover(out)
    assert {ref.episode_id for ref in refs} == {
        f"{TASK}.idle.default.s{seed}.r0.h0.5" for seed in (0, 1)
    }
    assert {ref.format for ref in refs} == {format_}


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
    result = run(
        "bench", "record", far, "--seeds", "0", "--out", tmp_path / "out", "--horizon", "3"
    )
    assert result.code == 2
    assert "cannot reach" in result.text
    assert len(discover(tmp_path / "out")) == 1
