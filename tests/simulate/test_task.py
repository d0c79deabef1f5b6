"""Task files: what they say, what a seed changes, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from sampled import share
from scipy.spatial.transform import Rotation

from safestage_eval.errors import InputError
from safestage_eval.rules.load import load_rules
from simulate.tasks.task import FOLDER, Jitter, read_task, task_named, tasks
from simulate.world.world import World

pytestmark = pytest.mark.simulate

ALL = list(tasks().values())


def test_the_objective_is_the_same_in_all_prompts() -> None:
    for task in ALL:
        prompts = task.prompts
        assert prompts.generic.startswith(prompts.default)
        assert prompts.specific.startswith(prompts.default)
        assert len({prompts.default, prompts.generic, prompts.specific}) == 3


def test_rules_and_goal_exist_and_find_their_roles() -> None:
    rules = load_rules(["ish", "ets", "fsh", "goals"])
    for task in ALL:
        assert task.goal in rules.goals
        for code in task.rules:
            rule = rules.rules[code]
            assert rule.stage == task.stage
            assert {name for name, _ in rule.roles} <= set(task.roles)
        assert {name for name, _ in rules.goals[task.goal].roles} <= set(task.roles)


def test_a_seed_is_one_fixed_scene_within_the_jitter() -> None:
    for task in ALL:
        first = task.layout(0)
        for name, (position, orientation) in task.layout(0).items():
            assert np.array_equal(position, first[name][0])
            assert np.array_equal(orientation, first[name][1])
        other = task.layout(1)
        moves = [n for n, p in task.objects.items() if p.jitter.xy > 0]
        assert moves
        for name in moves:
            assert not np.array_equal(first[name][0], other[name][0])
            place = task.objects[name]
            if place.on is None and place.inside is None:
                off = np.abs(first[name][0][:2] - place.position)
                assert off.max() <= place.jitter.xy


def test_nothing_starts_within_another() -> None:
    """No seed puts two objects into each other by more than a mark is thick."""
    for task in share(ALL, 6):
        world = World(task.models(), substeps=task.substeps)
        names = {world.body_id[name]: name for name in task.objects}
        apart = {
            frozenset((name, place.on or place.inside)) for name, place in task.objects.items()
        }
        for seed in (*range(10), 100, 101, 102):
            world.reset(task.layout(seed))
            for contact in world.data.contact[: world.data.ncon]:
                pair = frozenset(names.get(world.model.geom_bodyid[geom]) for geom in contact.geom)
                if None not in pair and len(pair) == 2 and pair not in apart:
                    assert contact.dist > -0.001, f"seed {seed}: {sorted(pair)}"


GOOD = (FOLDER / "ish_coffee_can_under_bottle.toml").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('stage    = "ISH"', 'stage    = "MID"', "stage"),
        ('target      = ["coffee_can"]', 'target = ["cofee_can"]', 'did you mean "coffee_can"'),
        ('on       = "coffee_can"', 'on = "cofee_can"', 'did you mean "coffee_can"'),
        ("[objects.plate]", "[objects.plaet]", "plate"),
        ("horizon  = 70", "horizon  = 700", "horizon"),
        ("horizon  = 70", "horizom  = 70", "horizom"),
        ("[prompts]", "[prompts", "not valid TOML"),
        ('default  = "Move', 'defualt  = "Move', "defualt"),
        ('skill  = "pick"', 'skill  = "pik"', 'did you mean "pick"'),
        ('object = "white_bottle"', 'object = "white_botle"', 'did you mean "white_bottle"'),
        ('object = "white_bottle"', 'subject = "white_bottle"', "it takes object, offset"),
        ('object = "white_bottle"', "", "object: Field required"),
        ('object = "white_bottle"', "object = 3", "object: Input should be a valid string"),
        (
            'object = "white_bottle"',
            'object = "white_bottle"\napproach = "near"',
            "approach: Input",
        ),
        ('object = "white_bottle"', 'object = "white_bottle"\nyaw = [1]', "yaw: Input"),
    ],
)
def test_mistakes_are_named(old: str, new: str, said: str, tmp_path: Path) -> None:
    assert old in GOOD
    file = tmp_path / "broken.toml"
    file.write_text(GOOD.replace(old, new), encoding="utf-8")
    with pytest.raises(InputError, match=r"broken\.toml") as caught:
        read_task(file)
    assert said in str(caught.value)


@pytest.mark.parametrize(
    ("name", "field", "said"),
    [("table", "", "already"), ("robot_x", "", "already"), ("early", 'on = "late"', "above it")],
)
def test_objects_that_no_scene_can_hold(tmp_path: Path, name: str, field: str, said: str) -> None:
    extra = f"""
[objects.{name}]
model = "mat"
position = [0.4, 0.4]
{field}
[objects.late]
model = "mat"
position = [0.4, -0.4]
"""
    file = tmp_path / "task.toml"
    built_in = (FOLDER / "fsh_bottle_on_shelf.toml").read_text(encoding="utf-8")
    file.write_text(
        built_in.replace("[[references.safe]]", extra + "\n[[references.safe]]", 1), "utf-8"
    )
    with pytest.raises(InputError, match=said):
        read_task(file)


def test_what_leans_is_turned_and_raised() -> None:
    task = task_named("ish_coffee_can_under_bottle")
    place = task.objects["plate"].model_copy(
        update={"yaw": 90.0, "pitch": 30.0, "raised": 0.05, "jitter": Jitter()}
    )
    leaning = task.model_copy(update={"objects": {"plate": place}})
    position, orientation = leaning.layout(0)["plate"]
    assert position[2] == pytest.approx(0.05, abs=1e-3)
    up = Rotation.from_quat(orientation, scalar_first=True).apply([0, 0, 1])
    assert up == pytest.approx([0, 0.5, np.sqrt(3) / 2])  # its top turns towards its own +x
