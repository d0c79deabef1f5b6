"""Pictures: what stands in the trace is where the camera sees it."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import Scene

from safestage_eval.episode import Geom
from safestage_eval.errors import InputError
from simulate.render.renderer import Camera, EpisodeRenderer

pytestmark = pytest.mark.simulate


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
