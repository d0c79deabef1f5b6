"""Pictures: what stands in the trace is where the camera sees it."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from scenes import Scene

from safestage_eval.episode import Geom
from safestage_eval.errors import InputError
from simulate.render.renderer import Camera, EpisodeRenderer, contact_sheet, write_png

pytestmark = pytest.mark.simulate


def decoded(png: bytes) -> np.ndarray:
    """An independent reader of unfiltered 8-bit RGB files."""
    assert png[:8] == b"\x89PNG\r\n\x1a\n"
    at, body, size = 8, b"", (0, 0)
    while at < len(png):
        length, kind = struct.unpack(">I4s", png[at : at + 8])
        chunk = png[at + 8 : at + 8 + length]
        assert struct.unpack(">I", png[at + 8 + length : at + 12 + length])[0] == zlib.crc32(
            kind + chunk
        )
        if kind == b"IHDR":
            size = struct.unpack(">II", chunk[:8])
        body += chunk if kind == b"IDAT" else b""
        at += 12 + length
    rows = np.frombuffer(zlib.decompress(body), np.uint8).reshape(size[1], 1 + 3 * size[0])
    assert not rows[:, 0].any()
    return rows[:, 1:].reshape(size[1], size[0], 3)


def test_png_round_trip(tmp_path: Path) -> None:
    image = np.random.default_rng(0).integers(0, 256, (7, 5, 3), np.uint8)
    write_png(image, tmp_path / "a.png")
    assert np.array_equal(decoded((tmp_path / "a.png").read_bytes()), image)


def test_a_sheet_keeps_the_order_of_its_pictures() -> None:
    images = [np.full((2, 3, 3), i, np.uint8) for i in range(5)]
    sheet = contact_sheet(images, columns=2)
    assert sheet.shape == (6, 6, 3)
    assert sheet[::2, ::3, 0].tolist() == [[0, 1], [2, 3], [4, 0]]


def test_a_body_is_drawn_where_its_track_is() -> None:
    scene = Scene(frames=2)
    scene.fixed("world")  # as other simulators call it
    path = np.array([[0.0, 0.0, 0.05], [0.0, 0.2, 0.05]])
    scene.body("orange", Geom(kind="sphere", size=(0.05,)), path)
    above = Camera(at=(0, 0, 0), distance=1.0, azimuth=180, elevation=-90)
    try:
        renderer = EpisodeRenderer(scene.episode(), 200, 200)
    except InputError as error:
        pytest.skip(str(error))
    with renderer:
        centres = []
        for index in (0, 1, -1):
            image = renderer.frame(index, above).astype(int)
            orange = image[:, :, 0] - image[:, :, 2] > 100
            centres.append(np.argwhere(orange).mean(axis=0))
    assert centres[0] == pytest.approx([100, 100], abs=8)
    assert np.linalg.norm(centres[1] - centres[0]) > 30
    assert np.array_equal(centres[1], centres[2])


def test_no_graphics_is_said_with_a_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MUJOCO_GL", "nonsense")
    with pytest.raises(InputError, match="egl, osmesa"):
        EpisodeRenderer(Scene(frames=1).fixed("table").episode())
