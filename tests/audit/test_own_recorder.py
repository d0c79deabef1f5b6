"""Recordings as somebody's own recorder writes them: a cube pushed over a table, and no robot."""

import math
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner

from safestage_eval.audit import audit
from safestage_eval.cli import group
from safestage_eval.episode import Body, Geom, Header
from safestage_eval.formats import TraceWriter, load, save
from safestage_eval.rules import builtin_names, load_rules
from safestage_eval.verdicts import judge
from safestage_eval.verdicts.explain import cause_and_remedy

TRACES = Path(__file__).parents[2] / "traces"


def record(path, *, turn=lambda t: (1.0, 0, 0, 0), spin=lambda t: (0, 0, 0), place=None, vase=True,
           up=lambda v: v, seconds=6.5, **header):  # fmt: skip
    """A cube moves by 10 cm in the first second, at 100 Hz. Returns the path."""
    given = {"roles": {"target": ("cube",), "protected": ("vase",) if vase else ()}, **header}
    given = {"success": True, "success_time": 1.0, "physics_dt": 0.01, "frame_dt": 0.01, **given}
    with TraceWriter(Header(episode_id="own", **given), path=path) as writer:
        top, cube = Geom(kind="box", size=up((0.5, 0.4, 0.02))), (0.03, 0.03, 0.03)
        writer.add_body(Body(name="table", kind="fixture", movable=False, geoms=(top,)),
                        up((0, 0, -0.02)))  # fmt: skip
        writer.add_body(Body(name="cube", kind="object", mass=0.2, up_axis=(0, 0, 1),
                             geoms=(Geom(kind="box", size=cube),)))  # fmt: skip
        if vase:
            shape = Geom(kind="box", size=(0.04, 0.04, 0.04))
            writer.add_body(Body(name="vase", kind="object", mass=0.5, geoms=(shape,)))
        for frame in range(round(100 * seconds) + 1):
            t = frame * 0.01
            at = (0.1 * min(t, 1), 0, 0.03) if place is None else place(t)
            going = up((0.1 * (t < 1), 0, 0))
            poses, rates = {"cube": (up(at), turn(t))}, {"cube": (going, spin(t))}
            if vase:
                poses["vase"], rates["vase"] = (up((0.3, 0.2, 0.04)), turn(0)), ((0,) * 3,) * 2
            writer.add_frame(t, poses, rates)
    return path


def findings(path, *select):
    return {found.code: found for found in audit(path, select=select).findings}


def spinning(rate, axis, *, xyzw=False):
    """Turn and angular velocity about an axis, for a second."""

    def turn(t):
        half = rate * min(t, 1) / 2
        q = [math.cos(half), 0, 0, 0]
        q[1 + axis] = math.sin(half)
        return tuple(q[1:] + q[:1]) if xyzw else tuple(q)

    def spin(t):
        return tuple(rate * (t < 1) * (k == axis) for k in range(3))

    return {"turn": turn, "spin": spin}


@pytest.mark.parametrize("code", ["ETS101", "ETS102", "ETS201", "FSH101", "FSH103"])
def test_an_assigned_rule_is_undecidable_where_its_verdict_is_inconclusive(tmp_path, code):
    path = record(tmp_path / "own.mcap", rules=(code,))
    [verdict] = [
        v for v in judge(load(path), load_rules(builtin_names())).verdicts if v.rule == code
    ]
    assert ("AUD157" in findings(path, "AUD157")) == (verdict.verdict == "inconclusive")


def test_success_in_seconds_of_stamps_in_milliseconds_is_one_mistake(tmp_path):
    """Success at 3 s, long before anything moves at "1500 s", is of the stamps' unit."""
    late = record(tmp_path / "late.mcap", place=lambda t: (0.1 * (t > 1.5), 0, 0.03))
    episode = load(late)
    header = episode.header.model_copy(update={"frame_dt": 10.0})
    save(replace(episode, t=1000 * episode.t, header=header, path=None), tmp_path / "ms.mcap")
    assert "AUD311" in findings(late, "AUD102", "AUD311")
    assert [*findings(tmp_path / "ms.mcap", "AUD102", "AUD311")] == ["AUD102"]


@pytest.mark.parametrize("role", ["protcted", "protectd"])
def test_a_misspelt_role_is_found_without_assigned_rules(tmp_path, role):
    path = record(tmp_path / "own.mcap", roles={"target": ("cube",), role: ("vase",)})
    found = findings(path, "AUD152")["AUD152"]
    assert (found.severity, found.fix) == ("warning", f"rename roles.{role} to roles.protected")
    other = record(tmp_path / "other.mcap", roles={"target": ("cube",), "spectator": ("vase",)})
    assert not findings(other, "AUD152")


@pytest.mark.parametrize("height", [0.03, 0.2])
def test_without_a_robot_nobody_knows_who_moves_turns_or_holds_what(tmp_path, height):
    """A cube is lowered by 3 cm, tipped over, and (at 20 cm) held in the air."""
    path = record(tmp_path / "own.mcap", place=lambda t: (0.1 * min(t, 1), 0, height - 0.03 * min(t, 1)),
                  **spinning(1.5, 1))  # fmt: skip
    assert {f.severity for f in findings(path, "AUD202", "AUD203", "AUD204", "AUD206", "AUD207").values()
            } <= {"note"}  # fmt: skip


def test_score_and_files_point_to_the_audit_of_what_contradicts_itself(tmp_path):
    """Positions in centimetres beside velocities in m/s."""
    path = record(tmp_path / "cm.mcap", place=lambda t: (10 * min(t, 1), 0, 3.0), vase=False)
    arguments = [str(path), "--rules", "fsh"]
    for command in (["score"], ["audit", "--files"]):
        done = CliRunner().invoke(group, [*command, *arguments])
        assert f"safestage audit {path} " in done.stderr
    assert findings(path, "AUD1")["AUD101"].cause.endswith("in centimetres")
    sound = CliRunner().invoke(group, ["score", str(record(tmp_path / "m.mcap")), "--rules", "fsh"])
    assert "safestage audit" not in sound.stderr


def test_a_margin_to_an_edge_names_the_surface(tmp_path):
    path = record(
        tmp_path / "edge.mcap", place=lambda t: (0.36 + 0.1 * min(t, 1), 0, 0.03), vase=False
    )
    [verdict] = [v for v in judge(load(path), load_rules(["fsh"])).verdicts if v.rule == "FSH102"]
    assert verdict.signal == "edge_margin(cube)"
    assert "edge_margin(cube) on table was" in verdict.explanation


@pytest.mark.parametrize(("number", "word"), [(math.nan, "NaN"), (math.inf, "infinite")])
def test_what_was_not_measured_is_named_by_audit_and_score(tmp_path, number, word):
    """The tracker loses the cube from 2 to 2.5 s."""
    path = record(tmp_path / "own.mcap", rules=("FSH104",),
                  place=lambda t: (number,) * 3 if 1.995 < t < 2.495 else (0.1 * min(t, 1), 0, 0.03))  # fmt: skip
    found = findings(path)
    assert f"position of 'cube' is {word} in 50 of 651 frames (7.7 %), from 2.00 s to 2.49 s" in (
        found["AUD119"].what)  # fmt: skip
    assert not {code for code, one in found.items() if one.severity == "error"}
    verdicts = {v.rule: v for v in judge(load(path), load_rules(["fsh"])).verdicts}
    cause, remedy = cause_and_remedy(verdicts["FSH104"].explanation)
    assert cause == f"the position of cube is {word} from 2.00 s to 2.49 s"
    assert remedy
    assert not findings(record(tmp_path / "whole.mcap"), "AUD119")


def test_shapes_tell_that_y_points_up(tmp_path):
    """Everything is turned so that the cube stands on the table along y; gravity is the default."""
    turned = record(tmp_path / "y.mcap", up=lambda v: (v[0], v[2], v[1]), vase=False)
    found = findings(turned, "AUD113", "AUD202", "AUD204")
    assert [*found] == ["AUD113"]
    assert found["AUD113"].cause == "the y axis points up"
    assert not findings(record(tmp_path / "z.mcap"), "AUD113")
    held = record(tmp_path / "held.mcap", place=lambda t: (0.1 * min(t, 1), 0, 0.3))
    assert not findings(held, "AUD113")
