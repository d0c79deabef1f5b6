"""A trace of ours, exported to a foreign layout and imported again: what came through, and what not.

Poses agree to float precision. A verdict is the same or inconclusive: where it does not need what was
lost it is the same, and what is lost never makes a pass. "What was lost" is taken by hand from the
original, and every verdict of the import must be that of this poorer original. Of a body that is
touched where none of its shapes is (a strap that was not drawn), the map file gives no shape.
"""

import numpy as np
import pytest
from exports import RIGID, map_text, write_lerobot, write_maniskill, write_robolab
from rlds_sets import write_rlds
from sampled import share

from safestage_eval.episode import Body, Episode, RobotFrames, Track, still_track
from safestage_eval.evidence.measure import Signals
from safestage_eval.formats import load
from safestage_eval.importers import Settings, import_all, load_map
from safestage_eval.relations.relations import Relations
from safestage_eval.rules import load_rules
from safestage_eval.rules.files import builtin_folder
from safestage_eval.sketch import resolve
from safestage_eval.verdicts import judge

LAYOUTS = ("robolab", "maniskill", "lerobot", "rlds")
FOLDER = [builtin_folder() / "examples"]
EXAMPLES = {
    # sketch: (rule, verdict, verdict per layout); "?" is inconclusive. Whether the hand has what it
    # takes off is inferred from its path (RoboLab); without that a hand may have had it all the time.
    "bottle_taken_off_first": ("ISH101", "pass", "p???"),
    "can_from_under_bottle": ("ISH101", "violation", "v???"),
    "obstacle_swept_off_step": ("ETS103", "violation", "v???"),
    "placed_on_shelf(margin = 1.9)": ("FSH101", "violation", "?vvv"),
    "placed_on_shelf(margin = 2.1)": ("FSH101", "pass", "?ppp"),
    "left_beside": ("FSH205", "violation", "????"),
}
LETTERS = {"?": "inconclusive", "v": "violation", "p": "pass"}


@pytest.fixture(scope="module")
def rules():
    return load_rules(["ish", "ets", "fsh"])


def unshaped(episode: Episode) -> set[str]:
    """One of each two bodies that exchange a force while their shapes are more than 1 mm apart."""
    facts = Relations(Signals(episode))
    bodies, forces = episode.header.bodies, facts.signals.contact_sums
    found: set[str] = set()
    for i, body in enumerate(bodies):
        for j in forces.beside(i) if body.kind == "object" else ():
            if bodies[j].kind not in RIGID or bodies[j].name in found:
                continue
            if (forces.touching(i, j) & ~facts.proximity.touching(i, j)).any():
                found.add(body.name)
    return found


def exported(episode: Episode, layout: str, folder, tmp_path):
    """The foreign file or folder, and the map file."""
    text = map_text(episode, success=layout in ("lerobot", "rlds"), unshaped=unshaped(episode))
    if layout == "robolab":
        source = write_robolab(folder, [episode], boxes=False)
    elif layout == "maniskill":
        source = write_maniskill(folder, episode)
    elif layout == "rlds":
        source, columns = write_rlds(folder, [episode])
        text += columns
    else:
        source, columns = write_lerobot(folder, [episode], "v3.0")
        text += columns
    path = tmp_path / "map.toml"
    path.write_text(text)
    return source, path


def poorer(episode: Episode, layout: str) -> Episode:
    """The original without what the layout cannot hold."""
    header = episode.header
    shapeless = unshaped(episode)
    bodies = [
        body.model_copy(update={"geoms": ()}) if body.name in shapeless else body
        for body in header.bodies
        if body.kind in RIGID
    ]
    tracks = {body.name: episode.tracks[body.name] for body in bodies}
    bodies.append(Body(name="robot_base", kind="robot", movable=False, untold=("links",)))
    tracks["robot_base"] = still_track((0, 0, 0), (1, 0, 0, 0))
    hand = next((body for body in header.bodies if body.kind == "gripper"), None)
    if layout == "robolab" and hand is not None:
        bodies.append(Body(name="gripper_base", kind="gripper"))
        tracks["gripper_base"] = episode.track(hand.name)
    frames = len(episode)
    fields = {"bodies": tuple(bodies), "joints": (), "force_source": "none"}
    if layout == "robolab" and header.success_time is not None:  # recording ends with success
        frames = int(np.searchsorted(episode.t, header.success_time - 1e-9)) + 1
        fields["post_success_hold"] = 0.0
    cut = {
        name: Track(*(c[: frames if len(track) > 1 else 1] for c in vars(track).values()))
        for name, track in tracks.items()
    }
    return Episode(
        header.model_copy(update=fields), episode.t[:frames], cut, None, RobotFrames.empty(frames),
        meshes=episode.meshes,
    )  # fmt: skip


def there_and_back(rules, tmp_path, name, layout) -> tuple[dict[str, str], dict[str, str]]:
    """Verdicts of the original, and of what came back."""
    ours = resolve(name, FOLDER)
    source, map_ = exported(ours, layout, tmp_path / "theirs", tmp_path)
    outcome = import_all(source, tmp_path / "data", Settings(map=load_map(map_)))
    assert not outcome.failed, outcome.failed
    back, less = load(tmp_path / "data"), poorer(ours, layout)
    assert len(back) == len(less)
    assert np.allclose(back.t, less.t, atol=1e-6)
    for body in less.header.bodies:
        if body.kind in RIGID:
            a, b = back.track(body.name), less.track(body.name)
            assert np.array_equal(a.position, b.position)
            assert np.abs(a.orientation - b.orientation).max() < 1e-6
            assert np.abs(a.linear_velocity - b.linear_velocity).max() < 1e-5
            assert np.array_equal(a.angular_velocity, b.angular_velocity)
    original, expected, found = (verdicts(e, rules) for e in (ours, less, back))
    assert found == expected
    assert turned(original, found) == {}
    return original, found


def verdicts(episode: Episode, rules) -> dict[str, str]:
    return {v.rule: v.verdict for v in judge(episode, rules).verdicts}


def turned(original: dict[str, str], found: dict[str, str]) -> dict[str, tuple[str, str]]:
    """Rule → what it was and is, where it is neither the same nor open."""
    return {
        rule: (original[rule], now)
        for rule, now in found.items()
        if now not in (original[rule], "inconclusive")
    }


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("name", EXAMPLES)
def test_there_and_back(rules, tmp_path, name, layout):
    original, found = there_and_back(rules, tmp_path, name, layout)
    rule, verdict, letters = EXAMPLES[name]
    assert original[rule] == verdict
    assert found[rule] == LETTERS[letters[LAYOUTS.index(layout)]]


def test_examples_of_every_rule(rules):
    """A share of the sketches that rules name: what RoboLab's layout loses, and what others do."""
    named = {name for rule in rules.rules.values() for name in (*rule.violates, *rule.passes)}
    for number, name in enumerate(share(sorted(named), 24)):
        ours = resolve(name, FOLDER)
        original = verdicts(ours, rules)
        layout = ("robolab", "maniskill")[number % 2]  # LeRobot's loses what ManiSkill's does
        changed = turned(original, verdicts(poorer(ours, layout), rules))
        assert changed == {}, (name, layout)
