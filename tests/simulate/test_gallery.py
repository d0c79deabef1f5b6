"""The gallery: small pictures, one line of three per task, every task on the page."""

from __future__ import annotations

import io
import re
from pathlib import Path

import numpy as np
import pytest

from safestage_eval.episode import Body, Geom, Header
from safestage_eval.formats import TraceWriter
from simulate.feasibility import gallery
from simulate.feasibility.gallery import CAMERAS, SIZE, Strip, clearest, page, webp, write_gallery
from simulate.render.renderer import EpisodeRenderer
from simulate.tasks.task import tasks

pytestmark = pytest.mark.simulate

DOCS = Path(__file__).parents[2] / "docs"
KILOBYTES = 20


def test_pictures_are_small_files() -> None:
    pillow = pytest.importorskip("PIL.Image")
    image = np.zeros((120, 300, 3), np.uint8)
    image[:, 100:200] = (200, 40, 40)
    again = np.asarray(pillow.open(io.BytesIO(webp(image))))
    assert again.shape == image.shape
    assert np.abs(again.astype(int) - image)[:, 110:190].mean() < 12


def test_the_page_has_every_task_once() -> None:
    text = page(list(tasks().values()))
    assert sorted(re.findall(r"^### (\S+)$", text, re.MULTILINE)) == sorted(tasks())
    for task in tasks().values():
        assert f"](gallery/{task.id}.webp)" in text
        assert task.prompts.specific in text


def test_only_what_is_asked_for_is_drawn_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    everything = list(tasks().values())[:3]
    monkeypatch.setattr(
        gallery, "strips", lambda chosen, *_: (Strip(task.id, b"new") for task in chosen)
    )
    folder = tmp_path / "gallery"
    folder.mkdir()
    (folder / f"{everything[0].id}.webp").write_bytes(b"old")
    (folder / "gone_task.webp").write_bytes(b"old")
    list(write_gallery(everything[1:2], everything, tmp_path))
    assert {p.stem: p.read_bytes() for p in folder.iterdir()} == {
        everything[0].id: b"old",
        everything[1].id: b"new",
    }
    shown = re.findall(r"^### (\S+)$", (tmp_path / "gallery.md").read_text("utf-8"), re.MULTILINE)
    assert shown == [everything[0].id, everything[1].id]


def test_what_is_in_docs_is_small_and_of_tasks_that_there_are() -> None:
    files = list((DOCS / "gallery").glob("*.webp"))
    assert {file.stem for file in files} <= set(tasks())
    assert [f.name for f in files if f.stat().st_size > 1000 * KILOBYTES] == []
    pillow = pytest.importorskip("PIL.Image")
    for file in files[:3]:
        with pillow.open(file) as picture:
            assert picture.size[0] == 3 * SIZE[0]


def test_the_camera_goes_round_what_hides_a_body() -> None:
    wall = TraceWriter(Header(episode_id="e", physics_dt=0.01, frame_dt=0.01))
    box = Geom(kind="box", size=(0.02, 0.3, 0.07))
    ball = Geom(kind="sphere", size=(0.03,))
    wall.add_body(Body(name="wall", kind="object", geoms=(box,)))
    wall.add_body(Body(name="ball", kind="object", geoms=(ball,)))
    unit, still = (1.0, 0.0, 0.0, 0.0), ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    # the first camera looks from +x and -y towards the middle
    poses = {"wall": ((0.55, -0.05, 0.07), unit), "ball": ((0.45, 0.0, 0.03), unit)}
    wall.add_frame(0.0, poses, {"wall": still, "ball": still})
    with EpisodeRenderer(wall.episode(), *SIZE) as renderer:
        assert clearest(renderer, ["wall"]) == CAMERAS[0]
        hidden = renderer.shown(0, CAMERAS[0]).get("ball", 0)
        found = clearest(renderer, ["wall", "ball"])
        assert found != CAMERAS[0]
        assert renderer.shown(0, found)["ball"] > 5 * hidden
