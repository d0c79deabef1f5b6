"""Sources of an episode's roles, goal, assigned rules and parameter values."""

import itertools
import tomllib

import pytest

from safestage_eval.episode import Body, Cavity, Header
from safestage_eval.errors import RuleError
from safestage_eval.rules import (
    bind_episode,
    bind_tables,
    parse_overrides,
)
from safestage_eval.rules.files import RuleFile
from safestage_eval.rules.load import merge

TEXT = """
[ruleset]
format = 1
name = "test"
version = "1"
[param]
near = "1 cm"
hold = "1 s"
[goal.there]
roles = { target = "object" }
require = { "supported(target)" = true }
[goal.here]
roles = { target = "object" }
require = { "held(target)" = false }
[[rule]]
code = "ETS901"
title = "t"
roles = { target = "object", other = "every object tagged fragile except target" }
require = { "clearance(target, other)" = ">= near" }
set = { near = "2 cm" }
"""

BODIES = (
    Body(name="mug", kind="object", tags=("fragile",), cavity=Cavity(kind="box", size=(1, 1, 1))),
    Body(name="vase", kind="object", tags=("fragile",)),
    Body(name="pot", kind="object"),
    Body(name="table", kind="fixture", movable=False),
    Body(name="finger", kind="gripper"),
)
BIND = {
    "task": {"tea": {"set": {"near": "5 cm"}, "roles": {"target": "vase"}, "rules": ["ETS902"]}}
}


def ruleset(*more: str):
    text = TEXT + "".join(more)
    return merge([RuleFile("test.toml", text, tomllib.loads(text), asked=True)])


def header(**more) -> Header:
    return Header(episode_id="e", physics_dt=0.01, frame_dt=0.01, task="tea", bodies=BODIES, **more)


def test_parameters_by_precedence() -> None:
    """Each further source, in this order, wins over all before it."""
    steps = [
        ("default", {}),
        ("trace header", {"header": True}),
        ("bind file", {"bind": True}),
        ("--set", {"override": True}),
    ]
    values = {"default": 0.02, "trace header": 0.04, "bind file": 0.05, "--set": 0.07}
    for count in range(1, len(steps) + 1):
        for chosen in itertools.combinations(steps, count):
            on = {key for _, options in chosen for key in options}
            rules = ruleset()
            binding = bind_episode(
                rules,
                header(family="pour", parameters={"near": "4 cm"} if "header" in on else {}),
                bind=bind_tables(BIND, rules) if "bind" in on else None,
                overrides={"near": "7 cm"} if "override" in on else {},
            )
            rule = rules.rules["ETS901"]
            assert binding.params(rule)["near"].value == pytest.approx(values[chosen[-1][0]])
            assert binding.provenance.get("param.near", "default") == chosen[-1][0]
            assert "param.hold" not in binding.provenance


def test_roles_goal_and_rules_by_precedence() -> None:
    said = {"roles": {"target": ("mug",)}, "goal": "there", "rules": ("ETS900",)}
    binding = bind_episode(ruleset(), header(**said))
    assert (binding.roles["target"], binding.goal.name, binding.assigned) == (
        ("mug",), "there", ("ETS900",),
    )  # fmt: skip
    bind = bind_tables(BIND, ruleset())
    binding = bind_episode(ruleset(), header(**said), bind=bind)
    assert (binding.roles["target"], binding.assigned) == (("vase",), ("ETS902",))
    assert binding.provenance["roles.target"] == "bind file"
    assert binding.provenance["goal"] == "trace header"


def test_every_body_of_a_kind_unless_bound() -> None:
    rules = ruleset()
    rule = rules.rules["ETS901"]
    one = header(roles={"target": ("mug",)})
    assert bind_episode(rules, one).players(rule, one) == {"target": ("mug",), "other": ("vase",)}
    bound = header(roles={"target": ("pot",), "other": ("vase",)})
    assert bind_episode(rules, bound).players(rule, bound)["other"] == ("vase",)
    nobody = header()
    assert bind_episode(rules, nobody).players(rule, nobody)["target"] == ()


@pytest.mark.parametrize(
    ("kind", "bodies"),
    [
        ("object", ("mug", "vase", "pot")),
        ("fixture", ("table",)),
        ("surface", ("mug", "vase", "pot", "table")),
        ("container", ("mug",)),
        ("gripper", ("finger",)),
        ("link", ("finger",)),
        ("body", ("mug", "vase", "pot", "table", "finger")),
        ("object tagged fragile", ("mug", "vase")),
    ],
)
def test_kinds(kind: str, bodies: tuple[str, ...]) -> None:
    text = TEXT.replace("every object tagged fragile except target", f"every {kind}")
    rules = merge([RuleFile("test.toml", text, tomllib.loads(text), asked=True)])
    players = bind_episode(rules, header()).players(rules.rules["ETS901"], header())
    assert players["other"] == bodies


def test_goal_in_the_header() -> None:
    goal = {"roles": {"target": "object"}, "require": {"supported(target)": True}}
    binding = bind_episode(ruleset(), header(goal=goal, roles={"target": ("mug",)}))
    assert binding.goal is not None
    assert binding.goal_players() == {"target": ("mug",)}
    with pytest.raises(RuleError, match="no signal or state called suported") as caught:
        bind_episode(ruleset(), header(goal={**goal, "require": {"suported(target)": True}}))
    assert "did you mean" in str(caught.value)


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ({"neer": "3 cm"}, ['a parameter "neer"', "did you mean", "near"] ),
        ({"near": "3 deg"}, ["near is in length", "angle", "m, cm, mm"]),
        ({"near": "3"}, ["near is in length", "has no unit"]),
        ({"near": "three cm"}, ["is not a quantity", "a length (m, cm, mm)", "default is"]),
        ({"hold": "3 cm"}, ["hold is in time", "frames @ r Hz"]),
    ],
)  # fmt: skip
def test_settings_that_do_not_fit(setting: dict[str, str], words: list[str]) -> None:
    with pytest.raises(RuleError) as caught:
        parse_overrides(ruleset(), setting)
    assert all(word in str(caught.value) for word in words), str(caught.value)
    assert next(iter(setting)) in caught.value.where
    if "neer" not in setting:  # parameters of rules that are not loaded are nobody's mistake
        with pytest.raises(RuleError, match="trace header"):
            bind_episode(ruleset(), header(parameters=setting))
    with pytest.raises(RuleError, match="bind file"):
        bind_tables({"task": {"tea": {"set": setting}}}, ruleset())
