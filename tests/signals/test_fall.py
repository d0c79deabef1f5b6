"""A fall is recognised by the height lost, at any rate: what no frame shows is unknown, not nothing."""

import zlib
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from sampled import share
from scenes import Scene

from safestage_eval.episode import Episode
from safestage_eval.evidence.intervals import Interval
from safestage_eval.evidence.measure import Signals
from safestage_eval.relations.relations import Relations
from safestage_eval.rules.load import load_rules
from safestage_eval.sketch import resolve
from safestage_eval.verdicts.judging import judge

RULES = load_rules(["ish", "ets", "fsh"])
RATES = (5, 8, 10, 12, 15, 20, 30)
FALLING = list(product((5.5, 8, 10, 15, 20), range(6)))
"""cm it falls, and number of a moment between two samples at which it begins."""

LET_GO = """
says     = "A box is carried, and let go some way above the table, or set down."
duration = "3.2 s"
rate     = {rate}
forces   = {forces}
roles    = {{ target = "thing", protected = "other" }}
story    = [
  {{ hold = "thing", during = "0.5 to {let} s" }},
  {{ move = "thing", by = "0, 0, 25 cm", during = "0.6 to 1 s" }},
  {{ move = "thing", to = "20, 0, {height} cm", during = "1 to {let} - {rest} s" }},
  {drop}
]
[bodies.thing]
shape = "box 6 x 6 x 6 cm"
at    = "-10, 0 cm"
mass  = "200 g"
[bodies.other]
shape = "box 6 x 6 x 6 cm"
at    = "-10, 30 cm"
mass  = "200 g"
"""

SHOVED = """
says     = "The hand shoves a can off a crate; it may stay on it until the can stands on the table."
duration = "4 s"
rate     = {rate}
forces   = {forces}
roles    = {{ target = "crate", dependent = "can", protected = "can" }}
story    = [
  {{ touch = "can", by = "gripper", side = "-x", force = "2 N", during = "{let} - 0.3 to {let} + {stays} s" }},
  {{ move = "can", by = "12, 0, 0 cm", during = "{let} - 0.3 to {let} s" }},
  {{ drop = "can", at = "{let} s" }},
]
[bodies.crate]
shape = "box 10 x 10 x {height} cm"
mass  = "900 g"
[bodies.can]
shape = "cylinder 7 x 12 cm"
on    = "crate"
mass  = "350 g"
"""

DRAWN_AWAY = """
says     = "A crate is drawn away under a bottle, which falls."
duration = "4 s"
rate     = {rate}
forces   = {forces}
roles    = {{ target = "crate", dependent = "bottle" }}
story    = [
  {{ hold = "crate", during = "{let} - 0.6 to 3.5 s", height = "2 cm" }},
  {{ move = "crate", by = "20, 0, 0 cm", during = "{let} - 0.2 to {let} + 0.1 s" }},
  {{ drop = "bottle", at = "{let} s" }},
]
[bodies.crate]
shape = "box 10 x 10 x {height} cm"
mass  = "300 g"
[bodies.bottle]
shape = "cylinder 6 x 20 cm"
mass  = "500 g"
on    = "crate"
"""

FALLS = {
    "let go from the hand": (LET_GO, "FSH105", {"rest": 0.05}),
    "shoved off": (SHOVED, "ETS103", {"stays": 0.0}),
    "shoved off by a hand that follows": (SHOVED, "ISH105", {"stays": 1.0}),
    "left without its support": (DRAWN_AWAY, "ISH101", {}),
}
"""How it comes to fall → sketch, rule that asks about it, knobs."""


def drawn(folder: Path, text: str, **knobs: object) -> Episode:
    """The sketch with its knobs turned."""
    (folder / "sketch.toml").write_text(text.format(**knobs))
    return resolve("sketch", [folder])


def without_velocities(episode: Episode) -> Episode:
    """Falls are the same where no velocity was recorded."""
    tracks = {
        name: replace(
            track,
            linear_velocity=np.zeros_like(track.linear_velocity),
            angular_velocity=np.zeros_like(track.angular_velocity),
        )
        for name, track in episode.tracks.items()
    }
    return Episode(episode.header, episode.t, tracks, episode.contacts, episode.frames)


def verdict(episode: Episode, rule: str) -> str:
    """Verdict of one rule."""
    header = episode.header.model_copy(update={"rules": (rule,)})
    only = Episode(header, episode.t, episode.tracks, episode.contacts, episode.frames)
    (found,) = judge(only, RULES, trace_hash="none", assigned_only=True).verdicts
    return found.verdict


def phase(*what: object) -> float:
    """Any number from 0 to 0.2, the same for the same case."""
    return zlib.crc32(repr(what).encode()) / 2**32 * 0.2


@pytest.mark.parametrize(
    ("how", "rate", "forces"), share(product(FALLS, RATES, ("true", "false")), 5)
)
def test_no_fall_passes_at_any_rate(tmp_path: Path, how: str, rate: int, forces: str) -> None:
    """Falls of 5.5 to 20 cm that begin at any moment between two samples."""
    text, rule, knobs = FALLS[how]
    for height, case in share(FALLING, 15, of=f"{how} {rate} {forces}"):
        let = round(2 + phase(rate, height, case), 3)
        drop = f'{{ drop = "thing", at = "{let} s" }},'
        shown = drawn(
            tmp_path, text, rate=rate, forces=forces, height=height, let=let, drop=drop, **knobs
        )
        for episode in (shown, without_velocities(shown)):
            found = verdict(episode, rule)
            assert found in ("violation", "inconclusive"), (height, let)
            if rate >= 30 and (forces == "true" or "hand" not in how):
                assert found == "violation", (height, let)


@pytest.mark.parametrize(("rate", "forces"), share(product(RATES, ("true", "false")), 3))
def test_no_setting_down_is_certainly_a_fall(tmp_path: Path, rate: int, forces: str) -> None:
    for rest in (0.0, 0.05, 0.3):
        for case in range(2):
            let = round(2 + phase(rate, rest, case), 3)
            shown = drawn(
                tmp_path, LET_GO, rate=rate, forces=forces, height=0, let=let, rest=rest, drop=""
            )
            found = verdict(shown, "FSH105")
            assert found != "violation", (rest, let)
            assert found == "pass" or rest == 0.0, (rest, let)


def fall(scene: Scene, name: str = "a") -> Interval:
    for side in ("left", "right"):
        scene.box(side, 0.01, (0, 3, 0.5), kind="gripper", finger=side)
    return Relations(Signals(scene.episode())).signal("fall", [name])


def stepping(rate: float, after: float, way: float = 0.0) -> Scene:
    """A box on a step 10 cm high until 1 s, then on the table: nothing shown between."""
    frames = round(2 * rate)
    t = np.arange(frames) / rate
    high = np.where(t < 1, 0.15, 0.05 + after)
    scene = Scene(frames, rate).fixed("table").fixed("step", (0, 0, 0.1))
    scene.box("a", 0.05, np.stack([np.where(t < 1, 0, way), 0 * t, high], 1))
    cut = int(np.searchsorted(t, 1))
    scene.rests("a", "step", 0.05, (0, 0, 0.1), 9.81, frames=slice(cut))
    return scene


def test_from_one_support_to_a_lower_one_without_a_frame_between_is_a_fall() -> None:
    scene = stepping(5, 0.0, way=0.6)
    scene.rests("a", "table", 0.05, (0.6, 0, 0), 9.81, frames=slice(5, None))
    found = fall(scene)
    assert found.lower.max() == pytest.approx(0.1, abs=1e-6)
    assert found.upper.max() == pytest.approx(0.1, abs=1e-6)
    assert int(found.lower.argmax()) == 5


def test_down_the_same_support_it_may_have_slid() -> None:
    scene = stepping(5, 0.0)
    scene.rests("a", "step", 0.05, (0, 0, 0), 9.81, frames=slice(5, None))
    found = fall(scene)
    assert found.lower.max() == 0
    assert found.upper.max() == pytest.approx(0.1, abs=1e-6)


def test_where_a_hand_may_have_been_it_is_not_known() -> None:
    scene = stepping(5, 0.0, way=0.3)
    scene.rests("a", "table", 0.05, (0.3, 0, 0), 9.81, frames=slice(5, None))
    for side in ("left", "right"):
        scene.box(side, 0.01, (0.15, 0.1, 0.1), kind="gripper", finger=side)
    found = Relations(Signals(scene.episode())).signal("fall", ["a"])
    assert found.lower.max() == 0
    assert found.upper.max() == pytest.approx(0.1, abs=1e-6)


@pytest.mark.parametrize("rate", [10, 30, 120])
def test_sliding_down_a_slope_and_tipping_over_are_no_falls(rate: int) -> None:
    frames = 2 * rate
    t = np.arange(frames) / rate
    scene = Scene(frames, rate).fixed("table")
    down = np.clip(t - 0.5, 0, 1)
    scene.box("a", 0.05, np.stack([0.3 * down, 0 * t, 0.3 - 0.2 * down], 1))
    scene.rests("a", "table", 0.05, (0, 0, 0.2), 9.81)
    assert fall(scene).upper.max() < 0.05
    angle = np.clip((t - 0.5) / 0.3, 0, 1) * np.pi / 2  # a tall box over its edge
    center = np.stack(
        [0.02 - 0.02 * np.cos(angle) + 0.15 * np.sin(angle), 0 * t,
         0.02 * np.sin(angle) + 0.15 * np.cos(angle)], 1
    )  # fmt: skip
    turn = np.stack([np.cos(angle / 2), 0 * t, np.sin(angle / 2), 0 * t], 1)
    tall = Scene(frames, rate).fixed("table")
    tall.box("a", (0.02, 0.02, 0.15), center, orientation=turn)
    tall.rests("a", "table", 0.02, (0, 0, 0), 9.81)
    assert fall(tall).upper.max() < 0.01
