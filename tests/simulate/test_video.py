"""Films and pictures with words: the moment of the verdict, roles in colours."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from scenes import Scene

from safestage_eval.errors import InputError
from safestage_eval.rules import load_rules
from safestage_eval.verdicts import EpisodeResult, judge
from safestage_eval.verdicts.verdict import Verdict
from simulate.render.marks import (
    bar_height,
    moment,
)

pytestmark = pytest.mark.simulate

RATE, FRAMES = 60.0, 181


def falls() -> tuple[object, EpisodeResult]:
    """The hand pushes a protected vase 20 cm off its place, from 1.0 s to 2.0 s."""
    scene = Scene(frames=FRAMES, rate=RATE)
    scene.fixed("table")
    y = 0.2 * np.clip(scene.t - 1.0, 0.0, 1.0)
    path = np.stack([0.4 + 0 * y, y, 0.05 + 0 * y], 1)
    scene.box("hand", 0.02, path - np.array([0, 0.07, 0]), kind="gripper")
    scene.box("vase", 0.05, path)
    scene.rests("vase", "table", 0.05, (0.4, 0, 0), 9.81)
    pushing = slice(round(RATE), round(2 * RATE))
    scene.contact("hand", "vase", (0.4, -0.05, 0.05), (0, 5, 0), (0, 1, 0), frames=pushing)
    scene.box("cube", 0.03, (0.6, 0.2, 0.03))
    episode = scene.episode()
    header = episode.header.model_copy(
        update={
            "episode_id": "falls",
            "roles": {"target": ("cube",), "protected": ("vase",)},
            "rules": ("ETS102",),
        }
    )
    episode = dataclasses.replace(episode, header=header)
    return episode, judge(episode, load_rules(["ets"]))


def verdict(code: str, name: str, time: float | None, margin: float = 0.1) -> Verdict:
    return Verdict(
        code, "", "ETS", assigned=True, verdict=name, time=time, worst_time=2.5,  # type: ignore[arg-type]
        margin_normalised=margin, explanation=f"{code} words",
    )  # fmt: skip


def told(*found: Verdict) -> EpisodeResult:
    return EpisodeResult(
        "e", "", None, None, None, None, None, None, None, None, None, "", "", tuple(found)
    )


def test_the_moment_is_the_worst_of_the_first_violation_or_else_the_closest_call() -> None:
    late, early = verdict("A", "violation", 4.0), verdict("B", "violation", 3.0)
    found = moment(told(verdict("C", "pass", None), late, early))
    assert (found.time, found.violated, found.words) == (2.5, True, "B violated: B words")
    found = moment(told(verdict("C", "pass", None)))
    assert (found.time, found.violated, found.words) == (2.5, False, "pass: C")
    assert moment(told(verdict("C", "not_applicable", None))).time is None


@pytest.mark.parametrize(("ending", "rate"), [(".gif", 10), (".mp4", 30), (".webp", 10)])
def test_a_film_stands_still_at_its_moment(tmp_path: Path, ending: str, rate: int) -> None:
    av = pytest.importorskip("av")
    from safestage_eval.viewer.camera_film import shows_verdict
    from simulate.render.video import STILL, film

    episode, result = falls()
    path = tmp_path / f"film{ending}"
    try:
        steps: list[tuple[int, int | None]] = []
        count = film(
            episode, result, path, size=(160, 120),  # type: ignore[arg-type]
            progress=lambda done, total: steps.append((done, total)),
        )  # fmt: skip
    except InputError as error:
        pytest.skip(str(error))
    assert count == 3 * rate + round(STILL * rate)
    assert steps == [(n + 1, count) for n in range(count)]
    if ending == ".webp":  # equal pictures are one that stands longer
        from PIL import Image, ImageSequence

        with Image.open(path) as shots:
            lasted = [
                shot.load() and shot.info["duration"] for shot in ImageSequence.Iterator(shots)
            ]
        assert sum(lasted) == count * 100
        return
    with av.open(str(path)) as file:
        pictures = [frame.to_ndarray(format="rgb24") for frame in file.decode(video=0)]
    if ending == ".mp4":
        assert len(pictures) == count
        assert shows_verdict(path)
        red = [p[1, 40].astype(int) @ [1, -1, 0] > 90 for p in pictures]
        assert sum(red) == pytest.approx(STILL * rate, abs=2)
        assert red.index(True) / rate == pytest.approx(moment(result).time, abs=0.1)
    assert pictures[0].shape[1] == 160
    assert pictures[0].shape[0] > 120 + bar_height(2)
    assert [p.name for p in tmp_path.iterdir()] == [path.name]
