"""Other libraries in the place of our own distances."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from bodies import box, put, shape, sphere, wanderer

from safestage_eval.episode import Geom, Mesh
from safestage_eval.errors import InputError
from safestage_eval.geometry import backend
from safestage_eval.geometry.group_clearance import SLACK, clearance_series

FLOOR = Geom(kind="plane")


@pytest.mark.parametrize("name", ["fcl", "coal"])
def test_tells_what_the_library_tells(name: str) -> None:
    pytest.importorskip(name)
    rng = np.random.default_rng(2)
    a, b = wanderer(rng, 120, 0.15), wanderer(rng, 1, 0.15)
    floor = put(FLOOR, (0, 0, -0.2))
    ours = clearance_series([a], [b, floor], 0.2)
    theirs = clearance_series([a], [b, floor], 0.2, backend=name)
    apart = (ours.lower > 1e-4) & (ours.upper < 0.2)
    assert apart.sum() > 20
    assert np.median(np.abs(theirs.upper - ours.upper)[apart]) < 1e-5
    assert ((theirs.upper <= 0) == (ours.upper <= 0)).mean() > 0.95
    beyond = ours.lower == 0.2
    assert (theirs.lower[beyond] == 0.2).all()
    assert (theirs.upper[beyond] == np.inf).all()


@pytest.mark.parametrize("name", ["fcl", "coal"])
def test_meshes_too(name: str) -> None:
    pytest.importorskip(name)
    source = trimesh.creation.box((0.1, 0.1, 0.1))
    mesh = Mesh.build(source.vertices, source.faces)
    cube = shape(Geom(kind="mesh", mesh=mesh.key), meshes={mesh.key: mesh})
    for other in (cube, shape(box(0.05, 0.05, 0.05)), shape(sphere(0.05))):
        found = clearance_series([put(cube, (0, 0, 0))], [put(other, (0.3, 0, 0))], backend=name)
        assert found.upper[0] == pytest.approx(0.2, abs=1e-5)


def test_fcl_is_wrong_where_it_is_known_to_be() -> None:
    cube = box(0.05, 0.05, 0.05)
    pair = [put(cube, (0, 0, 0))], [put(cube, (0, 0.3, 0))]
    assert clearance_series(*pair).upper[0] == pytest.approx(0.2, abs=1e-9)
    assert clearance_series(*pair, backend="fcl").upper[0] == pytest.approx(0.2236, abs=1e-3)


def test_a_missing_library_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(backend, "find_spec", lambda _: None)
    with pytest.raises(InputError, match=r"safestage\[coal\]"):
        backend.check_backend("coal")
    with pytest.raises(InputError, match="gjk, fcl, coal"):
        backend.check_backend("bullet")


def test_slack_leaves_no_limit_open() -> None:
    """A trembling block: what slack widens is marked, and measured again it is decided rightly."""
    rng = np.random.default_rng(0)
    tremble = rng.normal(size=(400, 3)) * 1e-6
    turn = np.tile([1.0, 0, 0, 0], (400, 1))
    block = put(box(0.05, 0.05, 0.05), tremble + np.array([0.2, 0, 0]), turn)
    wall = put(box(0.05, 0.05, 0.05), (0, 0, 0))
    exact, loose = clearance_series([block], [wall]), clearance_series([block], [wall], slack=SLACK)
    assert (loose.lower <= exact.upper + 1e-13).all()
    assert (exact.lower <= loose.upper + 1e-13).all()
    assert (loose.upper - loose.lower).max() <= 2 * SLACK + 1e-9
    for limit in np.concatenate([rng.normal(size=200) * 2e-6 + 0.1, [0.0999, 0.1001, -1, 1]]):
        if loose.leaves_open(limit):
            assert not exact.leaves_open(limit)
        else:
            assert ((loose.lower > limit) == (exact.upper > limit)).all()
            assert ((loose.upper < limit) == (exact.lower < limit)).all()
    assert loose.leaves_open(float(exact.upper[100]))
