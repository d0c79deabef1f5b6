"""Mistakes that are put into sound recordings are found, and each is named by its code."""

import zlib
from dataclasses import replace

import numpy as np
import pytest
from broken_scenes import SCENES, scene
from seeded_defects import RECORDING, TRACES, sound

from safestage_eval.audit import audit, choose
from safestage_eval.audit.audit_episode import check_subject
from safestage_eval.audit.subject import Subject
from safestage_eval.episode import Body, Geom, Header
from safestage_eval.formats import TraceWriter, load
from safestage_eval.rules import builtin_names, load_rules

CHECKED = [one for one in choose() if one.over != "campaign"]
GRAVE = ("error", "warning")


@pytest.fixture(scope="module")
def rules():
    return load_rules(builtin_names())


def found(seeded, name, rules):
    """Findings in an episode with a mistake, its amount drawn from a seed of its own."""
    rng = np.random.default_rng([zlib.crc32(name.encode()), 0])
    recording, body = seeded.where
    return check_subject(Subject(seeded.put(sound(recording), body, rng), rules), CHECKED)


@pytest.mark.parametrize("name", RECORDING)
def test_a_mistake_is_found_and_rightly_named(rules, name):
    seeded = RECORDING[name]
    findings = found(seeded, name, rules)
    grave = [f for f in findings if f.severity in GRAVE] or findings
    assert {f.code for f in grave} - {*seeded.also} == {seeded.code}, grave
    named = next(f for f in grave if f.code == seeded.code)
    assert seeded.cause in f"{named.cause} {named.fix}"
    assert named.fix
    assert named.what.endswith(".")


@pytest.mark.parametrize("name", SCENES)
def test_a_broken_scene_is_found_and_rightly_named(rules, name):
    broken = SCENES[name]
    rng = np.random.default_rng([zlib.crc32(name.encode()), 0])
    findings = check_subject(Subject(broken.build(rng), rules), CHECKED)
    grave = [f for f in findings if f.severity in GRAVE]
    assert {f.code for f in grave} - {*broken.also} == {broken.code}, grave
    assert broken.says in grave[0].what


@pytest.mark.parametrize("top", ["", "forces = false"])
def test_the_same_scene_unbroken_has_no_finding(rules, top):
    findings = check_subject(Subject(scene(top=top), rules), CHECKED)
    assert not [f for f in findings if f.severity in GRAVE]


def test_every_check_has_a_mistake_that_it_finds():
    found = {one.code for one in (*RECORDING.values(), *SCENES.values())}
    assert found == {one.code for one in CHECKED if one.of != "evaluation"}


def test_there_are_enough_kinds():
    assert len(RECORDING) + len(SCENES) >= 90


def test_recordings_that_are_sound_have_no_finding():
    assert not [f for f in audit(TRACES, select=["AUD1", "AUD2"]).findings if f.severity in GRAVE]


def test_the_cause_does_not_depend_on_what_was_audited_before(rules):
    names = [name for name, one in RECORDING.items() if one.cause][:4]
    there = {name: found(RECORDING[name], name, rules) for name in names}
    back = {name: found(RECORDING[name], name, rules) for name in reversed(names)}
    assert there == back


def written(tmp_path, orientation=(1, 0, 0, 0), speed=0.2, up=None, above=0.0):
    """A cube that is pushed over a table, as README writes it."""
    header = Header(episode_id="mine", physics_dt=0.01, frame_dt=0.01, roles={"target": ("cube",)},
                    success=True, success_time=1.0)  # fmt: skip
    with TraceWriter(header, path=tmp_path / "mine.mcap") as writer:
        top, side = (Geom(kind="box", size=s) for s in ((0.3, 0.3, 0.02), (0.03, 0.03, 0.03)))
        table = Body(name="table", kind="fixture", movable=False, geoms=(top,))
        writer.add_body(table, (0, 0, -0.02))
        writer.add_body(Body(name="cube", kind="object", mass=0.2, up_axis=up, geoms=(side,)))
        for frame in range(650):
            t = frame * 0.01
            falls = max(above - 4.9 * t**2, 0)
            pose = ((0.2 * min(t, 1), 0, 0.03 + falls), orientation)
            writer.add_frame(t, {"cube": pose}, {"cube": ((speed * (t < 1), 0, 0), (0, 0, 0))})
    return load(tmp_path / "mine.mcap", checked=False)


@pytest.mark.parametrize(
    ("changes", "code", "cause"),
    [
        ({}, None, ""),
        ({"orientation": (0, 0, 0, 1)}, "AUD111", "x, y, z, w"),
        (
            {"orientation": (0, 0, 0.5**0.5, 0.5**0.5), "up": (0, 0, 1)},
            "AUD111",
            "x, y, z, w",
        ),  # a cube looks alike
        ({"orientation": (0.9755, 0, 0, 0.22), "above": 0.01}, None, ""),  # let fall, as it says
        ({"speed": 20.0}, "AUD115", "cm/s"),
    ],
)
def test_a_recording_without_a_robot(rules, tmp_path, changes, code, cause):
    findings = check_subject(Subject(written(tmp_path, **changes), rules), CHECKED)
    grave = [f for f in findings if f.severity in GRAVE]
    assert [f.code for f in grave] == ([code] if code else [])
    assert all(cause in f.cause for f in grave)


@pytest.mark.parametrize("column", ["position", "orientation", "linear_velocity"])
def test_a_recording_whose_first_sample_is_missing_is_audited(rules, tmp_path, column):
    episode = written(tmp_path, up=(0, 0, 1))
    track = episode.track("cube")
    values = getattr(track, column).copy()
    values[0] = np.nan
    tracks = {**episode.tracks, "cube": replace(track, **{column: values})}
    findings = check_subject(Subject(replace(episode, tracks=tracks), rules), CHECKED)
    assert not [f for f in findings if f.severity in GRAVE and "w, x, y, z" in f.fix]
    assert any("missing" in f.what or "not measured" in f.what or "NaN" in f.what for f in findings)
