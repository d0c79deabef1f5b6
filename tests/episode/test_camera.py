"""Cameras and films in a header: kept in both forms, absent in older traces, refused when impossible."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from recordings import everything, falling_cube

from safestage_eval.episode import Camera, Video, check
from safestage_eval.formats import load

GOLDEN = Path(__file__).parents[1] / "formats" / "golden"
LENS = {"width": 64, "height": 48, "fx": 50.0, "fy": 50.0, "cx": 32.0, "cy": 24.0}


def camera(**more: Any) -> Camera:
    return Camera(**{"name": "eye", **LENS} | more)


@pytest.mark.parametrize("name", ["episode.mcap", "dataset"])
def test_both_forms_keep_them(tmp_path: Path, name: str) -> None:
    writer = everything()
    header = writer.header
    assert header.cameras
    assert header.video is not None
    writer.close(tmp_path / name)
    found = load(tmp_path / name).header
    assert (found.cameras, found.video) == (header.cameras, header.video)


@pytest.mark.parametrize("name", ["episode.mcap", "dataset"])
@pytest.mark.parametrize("version", ["1.0", "1.1"])
def test_older_traces_have_none(version: str, name: str) -> None:
    header = load(GOLDEN / version / name).header
    assert (header.cameras, header.video) == ((), None)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"body": "arm"}, "is on 'arm', which is no body"),
        ({"fx": 0.0}, "width, height, fx, fy"),
        ({"width": -1}, "width, height, fx, fy"),
        ({"cy": float("nan")}, "cx, cy"),
        ({"position": (0, 0, float("inf"))}, "position"),
        ({"orientation": (1, 1, 0, 0)}, "norm 1"),
    ],
)
def test_impossible_ones_are_reported(wrong: dict[str, Any], said: str) -> None:
    for fields in (
        {"cameras": (camera(**wrong),)},
        {"video": Video(file="a.mp4", rate=15, frames_per_picture=8, cameras=(camera(**wrong),))},
    ):
        found = check(falling_cube(**fields).episode())
        assert [said in str(error) for error in found] == [True]
        assert "camera 'eye'" in str(found[0])


def test_possible_ones_are_not() -> None:
    good = (camera(), camera(name="hand", body="cube", orientation=(0, 1, 0, 0)))
    assert check(falling_cube(cameras=good).episode()) == []
