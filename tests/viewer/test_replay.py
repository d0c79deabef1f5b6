"""The browser draws bodies where the trace says they are."""

import base64
import io

import numpy as np
import pytest
from scenes import Scene

from safestage_eval.episode import Geom, Mesh
from safestage_eval.viewer.film import film
from safestage_eval.viewer.html_page import page, replay_script

START = """
const data = Uint8Array.from(atob(document.querySelector("#film").textContent), (c) => c.charCodeAt(0));
const replay = new SafestageReplay(document.querySelector("canvas"), data.buffer);
globalThis.replay = replay;
"""
SIZE = "canvas { width: 600px; height: 400px; background: #204060; display: block }"


def show(tab, episode):
    canvas = '<canvas tabindex="0"></canvas><pre id="film" hidden>'
    body = [canvas, base64.b64encode(film(episode, rate=60)).decode(), "</pre>"]
    tab.set_content(page("replay", body, styles=[SIZE], scripts=[replay_script(), START]))


def picture(tab):
    """(H, W, 3) what the canvas shows."""
    from PIL import Image

    return np.asarray(Image.open(io.BytesIO(tab.locator("canvas").screenshot())).convert("RGB"))


MAGENTA = [1, 0, 1]


def is_magenta(pixels):
    r, g, b = (pixels[..., i].astype(int) for i in range(3))
    return (r > 60) & (b > 60) & (g < 0.3 * r)


def shapes():
    mesh = Mesh.build(np.array(np.meshgrid(*[[-0.05, 0.05]] * 3)).reshape(3, -1).T)
    kinds = [
        Geom(kind="box", size=(0.05, 0.05, 0.05)), Geom(kind="sphere", size=(0.05,)),
        Geom(kind="cylinder", size=(0.04, 0.05)), Geom(kind="capsule", size=(0.03, 0.03)),
        Geom(kind="ellipsoid", size=(0.03, 0.05, 0.06)), Geom(kind="convex_mesh", mesh=mesh.key),
    ]  # fmt: skip
    scene = Scene(60).fixed("table")
    for i, geom in enumerate(kinds):
        x, y = 0.3 + 0.3 * (i % 3), 0.2 - 0.4 * (i // 3)
        scene.body(geom.kind, geom, (x, y, 0.07))
    episode = scene.episode()
    object.__setattr__(episode, "meshes", {mesh.key: mesh})
    return episode, [geom.kind for geom in kinds]


def test_every_kind_of_shape_is_drawn_where_it_is(tab):
    episode, kinds = shapes()
    show(tab, episode)
    before = picture(tab)
    assert len(np.unique(before.reshape(-1, 3), axis=0)) > 50
    for kind in kinds:
        x, y = tab.evaluate(
            """([kind, colour]) => {
                replay.tint(kind, colour);
                return replay.project(replay.pose(replay.film.bodies.find((b) => b.name === kind)));
            }""",
            [kind, MAGENTA],
        )
        seen = is_magenta(picture(tab))
        tab.evaluate("(kind) => replay.tint(kind, null)", kind)
        rows, columns = np.nonzero(seen)
        assert len(rows) > 150, kind
        assert abs(np.median(columns) - x) < 12, kind
        assert abs(np.median(rows) - y) < 15, kind
    assert (picture(tab) == before).all()


def test_time_runs_and_poses_between_frames_are_in_between(tab):
    path = np.linspace([0.3, 0, 0.1], [0.6, 0.3, 0.4], 61)
    show(tab, Scene(61, 60).box("cube", 0.05, path).episode(roles={"target": ("cube",)}))
    at = tab.evaluate("() => { replay.seek(0.342); return replay.pose(replay.film.bodies[0]); }")
    assert at[:3] == pytest.approx([0.3 + 0.342 * 0.3, 0.342 * 0.3, 0.1 + 0.342 * 0.3], abs=1e-4)
    tab.evaluate("() => { replay.seek(0); replay.speed = 4; replay.play(); }")
    tab.wait_for_function("() => !replay.playing && replay.time === replay.end")
    tab.evaluate("() => { replay.seek(-5); }")
    assert tab.evaluate("replay.time") == 0
