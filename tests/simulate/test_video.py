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
    VIOLATED,
    bar_height,
    captioned,
    frame_at,
    in_rows,
    moment,
    role_colors,
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


def test_the_moment_is_the_first_violation_or_else_the_closest_call() -> None:
    late, early = verdict("A", "violation", 4.0), verdict("B", "violation", 3.0)
    found = moment(told(verdict("C", "pass", None), late, early))
    assert (found.time, found.violated, found.words) == (3.0, True, "B violated: B words")
    found = moment(told(verdict("C", "pass", None)))
    assert (found.time, found.violated, found.words) == (2.5, False, "pass: C")
    assert moment(told(verdict("C", "not_applicable", None))).time is None


def test_words_stand_below_the_picture_and_a_frame_about_it() -> None:
    image = np.full((60, 200, 3), 128, np.uint8)
    drawn = captioned(image, [("a very long line of words " * 9, VIOLATED)], VIOLATED)
    assert drawn.shape == (60 + bar_height(2), 200, 3)
    assert tuple(drawn[0, 0]) == tuple(round(255 * part) for part in VIOLATED)
    assert np.array_equal(drawn[6:54, 6:194], image[6:54, 6:194])
    assert (drawn[60:] < 250).any()
    plain = captioned(image, [])
    assert np.array_equal(plain[:60], image)
    assert (plain[60:] == 255).all()


def test_a_long_sentence_goes_on_in_the_next_row_and_nothing_of_it_is_cut() -> None:
    said = "ISH101 violated: coffee can moved at 3.21 s while white bottle still stood on it; it was freed at 5.22 s."
    assert in_rows(said, 640) == [said]  # the usual size of films
    rows = in_rows(said, 400)
    assert len(rows) == 2
    assert " ".join(rows) == said
    assert in_rows("short", 640) == ["short"]
    (row,) = in_rows("x" * 500, 640)
    assert row.endswith("…")
    image = np.full((60, 400, 3), 128, np.uint8)
    one, two = (captioned(image, [(said, VIOLATED)], rows=n) for n in (1, 2))
    assert two.shape[0] - one.shape[0] == bar_height(2) - bar_height(1)
    assert (two[60 + bar_height(1) :] < 250).any()


def test_frames_are_those_of_a_time() -> None:
    episode, result = falls()
    assert frame_at(episode, 0.0) == 0  # type: ignore[arg-type]
    assert frame_at(episode, 1.0) == 60  # type: ignore[arg-type]
    assert frame_at(episode, 99.0) == FRAMES - 1  # type: ignore[arg-type]
    found = moment(result)
    assert found.violated
    assert 1.0 < (found.time or 0) < 1.2
    assert set(role_colors(episode.header)) == {"cube", "vase"}  # type: ignore[attr-defined]


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


def test_what_stands_still_is_drawn_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Moving from 1.0 s to 2.0 s of three: no picture is drawn anew before, and after once."""
    pytest.importorskip("av")
    from simulate.render.renderer import EpisodeRenderer
    from simulate.render.video import film

    episode, result = falls()
    drawn: list[int] = []
    frame = EpisodeRenderer.frame

    def counted(self: EpisodeRenderer, index: int, *rest: object, **more: object) -> object:
        drawn.append(index)
        return frame(self, index, *rest, **more)  # type: ignore[arg-type]

    monkeypatch.setattr(EpisodeRenderer, "frame", counted)
    try:
        film(episode, result, tmp_path / "film.mp4", size=(160, 120))  # type: ignore[arg-type]
    except InputError as error:
        pytest.skip(str(error))
    times = [episode.t[index] for index in drawn]  # type: ignore[attr-defined]
    assert times[0] == 0
    assert all(1.0 <= time <= 2.1 for time in times[1:])
    assert 25 <= len(times) <= 32


@pytest.mark.parametrize(
    ("moved", "turned", "alike"),
    [
        (0.0, 0.0, True),
        (4e-4, 0.0, True),
        (6e-4, 0.0, False),
        (0.0, 1e-3, True),
        (0.0, 3e-3, False),
    ],
)
def test_frames_look_alike_within_a_quarter_of_a_pixel(
    moved: float, turned: float, alike: bool
) -> None:
    from simulate.render.renderer import EpisodeRenderer

    scene = Scene(frames=2)
    turn = np.array([[1.0, 0, 0, 0], [np.cos(turned / 2), 0, 0, -np.sin(turned / 2)]])
    turn[1] *= -1  # the same orientation, written with the other sign
    scene.box("cube", 0.03, np.array([[0.0, 0, 0.03], [moved, 0, 0.03]]), orientation=turn)
    try:
        with EpisodeRenderer(scene.episode(), 64, 64) as renderer:
            assert renderer.still(1, 0) is alike
            assert renderer.still(0, 1) is alike
    except InputError as error:
        pytest.skip(str(error))


def test_another_ending_is_refused(tmp_path: Path) -> None:
    from simulate.render.video import film

    episode, result = falls()
    with pytest.raises(InputError, match=r"\.mp4, \.gif"):
        film(episode, result, tmp_path / "film.avi")  # type: ignore[arg-type]
