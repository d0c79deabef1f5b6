"""Roles and rules from the command line: names, patterns, mistakes, and what they beat."""

from __future__ import annotations

import pytest

from safestage_eval.episode import Body, Geom, Header, Joint
from safestage_eval.errors import RuleError
from safestage_eval.rules import BindFile, bind_episode, bind_tables, load_binding, load_rules
from safestage_eval.rules.command_binding import command_binding

RULES = load_rules(["ish", "ets", "fsh", "goals"])
KINDS = {
    "table": "fixture", "cube": "object", "glass_1": "object", "glass_2": "object",
    "odd[1]": "object", "arm": "robot", "hand": "gripper",
}  # fmt: skip


def header(**fields) -> Header:
    shape = (Geom(kind="sphere", size=(0.03,)),)
    bodies = tuple(Body(name=n, kind=kind, mass=0.1, geoms=shape) for n, kind in KINDS.items())
    joints = (Joint(name="hinge", kind="revolute"),)
    return Header(
        episode_id="e", task="tidy", physics_dt=0.01, frame_dt=0.01, bodies=bodies, joints=joints,
        **fields,
    )  # fmt: skip


def bound(*roles: str, assign=(), protect=(), **fields):
    given = load_binding(None, RULES, assign, roles, protect)
    return bind_episode(RULES, header(**fields), bind=given)


@pytest.mark.parametrize(
    ("given", "players"),
    [
        (("target=cube",), {"target": ("cube",)}),
        (("target=cube,glass_1",), {"target": ("cube", "glass_1")}),
        (("target=cube", "target = glass_1"), {"target": ("cube", "glass_1")}),
        (("protected=glass*",), {"protected": ("glass_1", "glass_2")}),
        (("protected=glass_?,cube",), {"protected": ("glass_1", "glass_2", "cube")}),
        (("protected=*",), {"protected": ("cube", "glass_1", "glass_2", "odd[1]")}),
        (("target=odd[1]",), {"target": ("odd[1]",)}),  # a name before it is a pattern
        (("target=tab*",), {"target": ("table",)}),  # fits no object
        (("target=cube,vase*",), {"target": ("cube",)}),  # a pattern may fit none
        (("protected=",), {"protected": ()}),
        (
            ("target=cube", "protected=*"),
            {"target": ("cube",), "protected": ("glass_1", "glass_2", "odd[1]")},
        ),
    ],
)
def test_names_and_patterns(given, players) -> None:
    assert bound(*given).roles == players


def test_the_command_line_beats_header_and_bind_file() -> None:
    loaded = load_rules(["fsh"])
    file = bind_tables({"task": {"tidy": {"roles": {"target": "glass_1"}}}}, loaded)
    command = command_binding(loaded, ["FSH101"], ["target=cube"])
    said = header(roles={"target": ("table",)}, rules=("FSH102",))
    found = bind_episode(loaded, said, bind=BindFile("x", file.tasks, command=command))
    assert (found.roles["target"], found.assigned) == (("cube",), ("FSH101",))
    assert found.provenance["roles.target"] == found.provenance["rules"] == "command line"


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"roles": ["target=cub"]}, ["--role target=cub", "cube, glass_1", 'did you mean "cube"']),
        ({"roles": ["target=vase*"]}, ["vase*", "free for this role"]),
        ({"roles": ["target=cube", "protected=cub*"]}, ["cub*", "free for this role"]),
        ({"protect": ["cube,glas"]}, ["protected=glas", 'did you mean "glass_']),
    ],
)
def test_a_body_that_is_not_there(given, said) -> None:
    command = command_binding(RULES, **given)
    with pytest.raises(RuleError) as caught:
        bind_episode(RULES, header(), bind=BindFile(command=command))
    assert all(part in str(caught.value) for part in said), str(caught.value)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"assign": ["FSH999"]}, "no loaded rule has this code"),
        ({"assign": ["fsh101"]}, "no loaded rule has this code"),
        ({"roles": ["tarket=cube"]}, 'did you mean "target"'),
        ({"roles": ["cube"]}, "ROLE=BODIES"),
        ({"roles": ["=cube"]}, "ROLE=BODIES"),
    ],
)
def test_mistakes_are_reported_before_any_trace_is_read(given, said) -> None:
    with pytest.raises(RuleError, match=said):
        command_binding(RULES, **given)
