"""Where the picture says that two shapes are nearest is where the evaluator measures it."""

import numpy as np
import pytest
from scenes import Scene

from safestage_eval.episode import Geom
from safestage_eval.evidence.measure import Signals
from safestage_eval.viewer.module_links import linked

KINDS = {
    "box": (0.05, 0.03, 0.08), "sphere": (0.05,), "cylinder": (0.04, 0.07), "capsule": (0.03, 0.06),
    "ellipsoid": (0.03, 0.05, 0.08),
}  # fmt: skip
LIBRARY = linked("convex.js").removesuffix("})();\n") + (
    "globalThis.near = (a, p, b, q, flat) => { const [one] = convexParts({ geoms: [a] }, []), [other] = convexParts({ geoms: [b] }, []);"
    " return nearest(placed(one, p, flat), placed(other, q, flat)); }; })();"
)


def turned(seed):
    quaternion = np.random.default_rng(seed).normal(size=4)
    return quaternion / np.linalg.norm(quaternion)


def both(one, other, seed):
    """Two bodies of these kinds, turned at random, that pass each other: the episode, and their geoms."""
    frames = 13
    path = np.linspace([0.02, -0.25, 0.35], [0.16, 0.25, 0.05], frames)
    geoms = [Geom(kind=kind, size=KINDS[kind], orientation=tuple(turned(seed + i))) for i, kind in enumerate((one, other))]  # fmt: skip
    scene = Scene(frames, 60).body("a", geoms[0], path).body("b", geoms[1], (0, 0, 0.2))
    return (
        scene.episode(),
        [geom.model_dump(mode="json", exclude_none=True) for geom in geoms],
        path,
    )


@pytest.mark.parametrize("flat", [False, True], ids=["clearance", "clearance_xy"])
def test_the_segment_is_as_long_as_what_is_measured(tab, flat):
    tab.set_content("<p></p>")
    tab.evaluate(LIBRARY)
    for seed, (one, other) in enumerate((a, b) for a in KINDS for b in KINDS):
        episode, geoms, path = both(one, other, seed)
        name = "clearance_xy" if flat else "clearance"
        series = Signals(episode).get(name, ["a", "b"])
        measured = np.where(np.isfinite(series.upper), series.value, np.inf)
        poses = [[*map(float, at), 1, 0, 0, 0] for at in path]
        found = tab.evaluate(
            "([a, b, poses, flat]) => poses.map((p) => near(a, p, b, [0, 0, 0.2, 1, 0, 0, 0], flat))",
            [*geoms, poses, flat],
        )
        for expected, got in zip(measured, found, strict=True):
            distance = got["distance"]
            if expected > 0.099:  # beyond the cap: at least so far
                assert distance > 0.098
                continue
            assert distance == pytest.approx(max(expected, 0), abs=5e-4), (one, other)
            if distance > 1e-3:  # and its ends lie so far apart
                ends = np.subtract(got["from"], got["to"])
                assert np.linalg.norm(ends) == pytest.approx(distance, abs=1e-6)
