"""What sets in motion what lay still: a touch, its weight, or something that was not recorded."""

import numpy as np
import pytest

from safestage_eval.episode import Body
from safestage_eval.evidence.unexplained_motion import Path, unexplained_motion

T = np.arange(240) / 120
STILL = np.zeros(240)
PUSHED, EARLIER, LATER = (np.clip(T - at, 0, 0.5) * 0.1 for at in (1.0, 0.8, 1.2))
FALLEN = -4.905 * np.clip(T - 1.0, 0, 0.3) ** 2
NAMES = ("table", "cup", "can", "hand")
TABLE = {(0, 1): np.arange(240), (0, 2): np.arange(240)}
SOON = np.arange(90, 240)


def moved(x, z=STILL, can=STILL, touches=None, lost=STILL, turn=STILL):
    """Names of the bodies whose motion is not explained: a cup of this path (m), beside a can."""
    bodies = [
        Body(name=n, kind=k, movable=n != "table")
        for n, k in zip(NAMES, ("fixture", "object", "object", "gripper"), strict=True)
    ]
    upright = np.column_stack([np.cos(turn / 2), STILL, STILL, np.sin(turn / 2)])
    known = np.zeros(240, np.bool_)
    paths = {
        1: Path(np.column_stack([x, STILL, z]), upright, lost.astype(np.bool_)),
        2: Path(np.column_stack([can + 0.1, STILL, STILL]), upright * 0 + (1, 0, 0, 0), known),
    }
    touches = TABLE if touches is None else touches
    found = unexplained_motion(T, paths, list(touches), touches.__getitem__, bodies)
    assert all(0.6 < T[frame] < 1.0 for frame in found.values())
    return {NAMES[body] for body in found}


@pytest.mark.parametrize(
    ("why", "unexplained", "case"),
    [
        ("nothing touches it", {"cup"}, {"x": PUSHED}),
        ("turned on the spot", {"cup"}, {"x": STILL, "turn": 3 * PUSHED}),
        ("lifted", {"cup"}, {"x": STILL, "z": PUSHED}),
        ("thrown off", {"cup"}, {"x": 20 * PUSHED, "z": FALLEN}),
        ("what it pushes is still", {"cup"}, {"x": PUSHED, "touches": TABLE | {(1, 2): SOON}}),
        ("both at once", {"cup", "can"},
         {"x": PUSHED, "can": PUSHED, "touches": TABLE | {(1, 2): SOON}}),
        ("it pushes what moves later", {"cup"},
         {"x": PUSHED, "can": LATER, "touches": TABLE | {(1, 2): SOON}}),
        ("the hand touches it", set(), {"x": PUSHED, "touches": TABLE | {(1, 3): SOON}}),
        ("the hand touches what moves with it", set(),
         {"x": PUSHED, "can": PUSHED, "touches": TABLE | {(1, 2): SOON, (2, 3): SOON}}),
        ("what came moves it", {"can"},
         {"x": PUSHED, "can": EARLIER, "touches": TABLE | {(1, 2): SOON}}),
        ("it falls", set(), {"x": STILL, "z": FALLEN}),
        ("it slides down", set(), {"x": 0.5 * PUSHED, "z": -0.5 * PUSHED}),
        ("it creeps", set(), {"x": 0.001 * T}),
        ("it rolls slowly", set(), {"x": 0.008 * np.clip(T - 1, 0, 1)}),
        ("a wobble", set(), {"x": 0.004 * np.sin(20 * np.clip(T - 1, 0, 1))}),
        ("it moves from the start", set(), {"x": 0.1 * T}),
        ("not seen", set(), {"x": PUSHED, "lost": (T > 0.9) & (T < 1.1)}),
        ("nothing bears it: it has a drive", set(), {"x": PUSHED, "touches": {}}),
    ],
)  # fmt: skip
def test_what_is_explained(why, unexplained, case):
    assert moved(**case) == unexplained, why
