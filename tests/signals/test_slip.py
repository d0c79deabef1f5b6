"""How far a held body slips in the hand, wherever the hand goes."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scenes import Scene

from safestage_eval.episode import Tcp
from safestage_eval.evidence.measure import Signals
from safestage_eval.evidence.reference import Reference, latest
from safestage_eval.geometry.pose import product, rotate
from safestage_eval.relations.relations import Relations

FRAMES = 40


def grasped(drift: np.ndarray, held: list[slice], seed: int = 0, **hand) -> Scene:
    """A hand on a wild path, and a box that drifts by ``drift`` (T, 3) m in the hand's frame."""
    rng = np.random.default_rng(seed)
    path = np.cumsum(rng.normal(0, 0.02, (FRAMES, 3)), axis=0)
    angles = np.cumsum(rng.normal(0, 0.1, FRAMES))
    spin = np.column_stack([np.cos(angles), 0.6 * np.sin(angles), 0.8 * np.sin(angles), 0 * angles])
    offset, twist = np.array([0.03, -0.01, 0.02]), np.array([0.8, 0, 0.6, 0])
    hand = hand or {"tcp": Tcp(position=(0, 0, 0.1), orientation=(1, 0, 0, 0))}
    scene = Scene(FRAMES).box("hand", 0.02, path, kind="gripper", orientation=spin, **hand)
    com = path + rotate(spin, np.array([0, 0, 0.1]) + drift)
    turn = product(spin, twist)
    scene.box("a", 0.03, com - rotate(turn, offset), orientation=turn, com=tuple(offset))
    for side in ("left", "right"):
        scene.box(side, 0.01, path, kind="gripper", finger=side, parent="hand")
        for frames in held:
            sign = 1 if side == "left" else -1
            scene.contact(side, "a", (0, 0, 0), (5 * sign, 0, 0), (sign, 0, 0), frames)
    return scene


def slip(scene: Scene, since: list[int] | None = None, **header):
    signals = Signals(scene.episode(**header))
    reference = None
    if since is not None:
        reference = Reference(signals.baseline, latest(np.array(since), FRAMES), str(since))
    return Relations(signals).signal("slip", ["a"], reference)


@given(st.integers(0, 30))
def test_a_body_that_slips_one_centimetre(seed: int) -> None:
    """1 cm out of the hand between frames 15 and 25, held from frame 10 to 34."""
    down = np.clip((np.arange(FRAMES) - 15) / 10, 0, 1) * 0.01
    drift = np.column_stack([0 * down, 0.6 * down, 0.8 * down])
    found = slip(grasped(drift, [slice(10, 35)], seed)).value
    assert np.allclose(found[10:35], down[10:35], atol=1e-6)
    assert (found[:10] == 0).all()
    assert (found[35:] == 0).all()


def test_without_forces_it_needs_the_shapes_of_the_fingers() -> None:
    """A body that merely moves with the hand would be held only as long as it does not slip."""
    drift = np.zeros((FRAMES, 3))
    drift[20:, 2] = 0.01
    scene = grasped(drift, [slice(10, 35)])
    scene.bodies = [b.model_copy(update={"geoms": ()}) if b.finger else b for b in scene.bodies]
    found = slip(scene, force_source="none")
    assert not found.known.any()
    assert found.notes
    scene = grasped(drift, [slice(10, 35)])
    box = scene.tracks["a"]
    for name, side in (("left", -1), ("right", 1)):
        track = scene.tracks[name]
        at = box.position + rotate(box.orientation, np.array([0, 0.038 * side, 0]))
        scene.tracks[name] = type(track)(**{**vars(track), "position": at.astype(np.float32)})
    found = slip(scene, force_source="none")
    assert np.allclose(found.value[20:], 0.01, atol=1e-6)
    assert "without contact forces held()" in found.notes[0]
