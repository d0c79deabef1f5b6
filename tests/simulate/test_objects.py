"""The catalogue: objects weigh, stand and hold what their rows say."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.spatial.transform import Rotation
from worlds import put, recorder_of, world_of

from safestage_eval.episode import Body, Cavity
from safestage_eval.geometry.extent import highest, lowest
from safestage_eval.geometry.mover import Mover
from safestage_eval.geometry.shape import BodyShape
from simulate.catalogue.objects import ObjectModel, catalogue

pytestmark = pytest.mark.simulate


@pytest.fixture(scope="module")
def bodies() -> dict[str, Body]:
    world = world_of(*catalogue())
    put(world, **{name: [0.0, 0.0, i * 1.0] for i, name in enumerate(catalogue())})
    return {body.name: body for body in recorder_of(world).writer.header.bodies}


def test_it_stands_on_its_origin_and_is_as_high_as_the_row_says(bodies: dict[str, Body]) -> None:
    for name in catalogue():
        still = np.zeros((1, 3)), np.array([[1.0, 0, 0, 0]])
        mover = Mover(BodyShape.build(bodies[name], {}), *still)
        assert lowest(mover)[0] == pytest.approx(0, abs=1e-9)
        assert highest(mover)[0] == pytest.approx(catalogue()[name].height, abs=1e-9)


def test_a_cavity_is_inside_and_open_at_the_top(bodies: dict[str, Body]) -> None:
    for name in catalogue():
        body = bodies[name]
        if body.cavity is None:
            continue
        rim = body.cavity.position[2] + body.cavity.size[-1]
        floor = body.cavity.position[2] - body.cavity.size[-1]
        assert rim <= catalogue()[name].height + 1e-9  # a basket's handle is higher
        assert floor > 0
        points = _points_in(body.cavity)
        for geom in body.geoms:  # no wall reaches into it
            local = (
                Rotation.from_quat(geom.orientation, scalar_first=True)
                .inv()
                .apply(points - np.asarray(geom.position))
            )
            if geom.kind == "box":
                inside = (np.abs(local) < np.asarray(geom.size) - 1e-9).all(1)
            else:
                assert geom.kind == "cylinder"
                inside = np.hypot(local[:, 0], local[:, 1]) < geom.size[0] - 1e-9
                inside &= np.abs(local[:, 2]) < geom.size[1] - 1e-9
            assert not inside.any()


def _points_in(cavity: Cavity) -> np.ndarray:
    """(N, 3) m, body frame: points all over the cavity, up to its boundary."""
    grid = np.stack(np.meshgrid(*[np.linspace(-1, 1, 41)] * 3), -1).reshape(-1, 3)
    if cavity.kind == "cylinder":
        angle, share = np.pi * grid[:, 0], (1 + grid[:, 1]) / 2
        grid = np.stack([share * np.cos(angle), share * np.sin(angle), grid[:, 2]], 1)
        half = np.array([cavity.size[0], cavity.size[0], cavity.size[1]])
    else:
        half = np.asarray(cavity.size)
    return grid * half + np.asarray(cavity.position)


@pytest.mark.parametrize(
    "fields",
    [
        {"region": True, "fixed": True},
        {"region": True, "mass": 0},
        {"mass": 0},
        {"heigth": 1.0},
        {"shapes": ()},
        {"shapes": [{"kind": "cone", "size": [1]}]},
    ],
)
def test_a_row_that_makes_no_sense_is_refused(fields: dict[str, object]) -> None:
    good = {"mass": 1, "height": 0.1, "shapes": [{"kind": "sphere", "size": [0.05]}]}
    ObjectModel.model_validate(good)
    with pytest.raises(ValidationError):
        ObjectModel.model_validate(good | fields)
