"""Scoring audits what it has read, says in one line what it found, and in JSON all of it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from test_campaign_summary import acting, headed, recorded

from safestage_eval.audit import audit
from safestage_eval.audit.audit_scores import audit_scores, look
from safestage_eval.cli import group
from safestage_eval.episode import Body, Geom, Header
from safestage_eval.formats import TraceWriter, save
from safestage_eval.run.score_traces import Choice, score_traces
from safestage_eval.run.settings import load_settings

TRACES = Path(__file__).parents[2] / "traces"
NAMES = ("bottle_on_shelf.reference-safe", "bottle_on_shelf.reference-unsafe")


@pytest.fixture(scope="module")
def idle(tmp_path_factory) -> Path:
    """Two rollouts: one without commands, and one under a misspelt role."""
    folder = tmp_path_factory.mktemp("traces")
    one, other = (recorded(name) for name in NAMES)
    save(acting(one, np.full_like(one.frames.action, 0.3)), folder / "a.mcap")
    save(headed(other, roles={**other.header.roles, "targt": ("bottle",)}), folder / "b.mcap")
    return folder


def run(*arguments: str):
    return CliRunner().invoke(group, ["score", *arguments, "--rules", "fsh"])


def test_one_line_says_what_was_found(idle: Path) -> None:
    done = run(str(idle))
    assert done.exit_code == 0, done.output
    [line] = [line for line in done.stderr.splitlines() if line.startswith("audit: ")]
    assert line.startswith("audit: 1 error in 1 of 2 episodes; safestage audit ")
    assert "audit:" not in run(str(TRACES)).stderr


def test_json_has_the_findings(idle: Path) -> None:
    document = json.loads(run(str(idle), "--format", "json").stdout)
    assert document["audit"]["counts"]["error"] == 1
    codes = {found["code"] for found in document["audit"]["findings"]}
    assert {"AUD321", "AUD352"} <= codes


def scored(folder: Path, jobs: int = 1, **choice):
    settings = load_settings(["fsh"]).copy_with(look=look)
    return audit_scores(score_traces([folder], settings, Choice(jobs=jobs, **choice)))


def test_whatever_runs_it_finds_the_same(idle: Path, tmp_path: Path) -> None:
    plain = scored(idle)
    assert plain is not None and plain.findings
    for again in range(2):
        assert scored(idle, resume=tmp_path / "resume") == plain, again
    assert scored(idle, jobs=2) == plain


def test_it_finds_what_the_audit_finds_by_its_cheap_checks(idle: Path) -> None:
    plain = scored(idle)
    whole = audit(idle, ["fsh"], select=plain.checks)
    assert {f.code for f in plain.findings} == {f.code for f in whole.findings}


def test_scoring_tells_quaternions_of_the_only_object_in_another_order(tmp_path: Path) -> None:
    """Nothing contradicts them where it is a box that is not turned."""
    header = Header(episode_id="mine", physics_dt=0.01, frame_dt=0.01, roles={"target": ("cube",)})
    for name, turn in (("sound", (1, 0, 0, 0)), ("xyzw", (0, 0, 0, 1))):
        with TraceWriter(header, path=tmp_path / name / "mine.mcap") as writer:
            top, side = (Geom(kind="box", size=s) for s in ((0.3, 0.3, 0.02), (0.03, 0.03, 0.03)))
            table = Body(name="table", kind="fixture", movable=False, geoms=(top,))
            writer.add_body(table, (0, 0, -0.02))
            writer.add_body(Body(name="cube", kind="object", mass=0.2, geoms=(side,)))
            for frame in range(50):
                pose = {"cube": ((0.001 * frame, 0, 0.03), turn)}
                writer.add_frame(frame / 100, pose, {"cube": ((0.1, 0, 0), (0, 0, 0))})
        found = scored(tmp_path / name)
        assert found is not None
        assert any(f.code == "AUD111" for f in found.findings) == (name == "xyzw")


def test_without_a_look_there_is_no_audit(idle: Path) -> None:
    assert audit_scores(score_traces([idle], load_settings(["fsh"]))) is None
