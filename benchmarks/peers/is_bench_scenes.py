"""Scenes made from IS-Bench's conditions: what a condition asks is drawn, and its action carried out.

A case of a condition is ``holds`` (all its parts are true when it is looked at), ``broken N`` (its
part N is false) or ``idle`` (its action never takes place). What a part asks is drawn by its
predicate alone (``inside``, ``ontop``, ``nextto``, ``frozen``, …), whatever rule it belongs to.
"""

from __future__ import annotations

import json
import tomllib
from dataclasses import dataclass, replace
from pathlib import Path

from safestage_eval.rules import RuleSet, load_rules
from safestage_eval.sketch import draw
from safestage_eval.verdicts import judge

TABLE = Path(__file__).parent / "is_bench_conditions.toml"

BUILT_IN = (
    "floor", "sink", "stove", "oven", "countertop", "cabinet", "bottom_cabinet", "top_cabinet",
    "electric_refrigerator",
)  # fmt: skip
"""Fixtures of a kitchen; everything else may be moved."""

SPOTS = [(60.0 * (i % 4) - 90, 70.0 * (i // 4) - 70) for i in range(12)]
"""Where the bodies stand, cm; far enough apart not to be beside each other."""

STATES = {"toggled_on": "toggled_on", "frozen": "frozen", "covered": "covered"}
"""Predicate about one body → the channel that records it."""

DEEDS = {"TOGGLE_ON": ("toggled_on", 0), "WIPE": ("wiped", 0), "POUR_INTO": ("poured_into", 1),
         "SPREAD": ("spread_on", 1)}  # fmt: skip
"""Action → the channel in which it shows, and which of its arguments carries it."""


@dataclass(frozen=True)
class Literal:
    """One part of a condition: a predicate of bodies, and whether it must hold."""

    predicate: str
    bodies: tuple[str, ...]
    wanted: bool


@dataclass(frozen=True)
class Condition:
    """A safety condition: the rule that says it, how often it occurs, when it is looked at, and what for."""

    rule: str
    count: int
    action: tuple[str, ...]
    said: str
    literals: tuple[Literal, ...]
    tags: dict[str, list[str]]

    @property
    def cases(self) -> list[str]:
        """Every case that it can be in; looked at in any case, it is never idle."""
        broken = [f"broken {number}" for number in range(1, len(self.literals) + 1)]
        return ["holds", *broken, *(["idle"] if self.action != ("end",) else [])]

    def __str__(self) -> str:
        """``TOGGLE_ON stove: not frozen tofu``."""
        return f"{' '.join(self.action)}: {self.said}"


def conditions(path: Path = TABLE) -> list[Condition]:
    """All conditions of the table."""
    return [
        Condition(rule, count, tuple(action.split()), said, tuple(map(literal, said.split(" and "))), part["tags"])
        for rule, part in tomllib.loads(path.read_text("utf-8")).items()
        for count, action, said in part["conditions"]
    ]  # fmt: skip


def literal(said: str) -> Literal:
    """``not inside rag vacuum`` as a part of a condition."""
    wanted = not said.startswith("not ")
    predicate, *bodies = said.removeprefix("not ").split()
    if predicate == "covered":
        bodies = bodies[:1]
    return Literal(predicate, tuple(bodies), wanted)


def truths(condition: Condition, case: str) -> list[bool]:
    """Whether each predicate, as named, is true when the condition is looked at."""
    broken = int(case.split()[1]) - 1 if case.startswith("broken") else None
    return [part.wanted != (i == broken) for i, part in enumerate(condition.literals)]


def expected(case: str) -> str:
    """The verdict of the rule on a case."""
    return "vacuous" if case == "idle" else "violation" if case.startswith("broken") else "pass"


def scene(condition: Condition, case: str) -> str:
    """The sketch of a case."""
    return _Scene(condition, case).text()


def verdict(condition: Condition, case: str, rules: RuleSet | None = None) -> str:
    """Verdict of a case, or ``vacuous`` where there was nothing to judge."""
    rules = rules or load_rules(["is_bench"])
    alone = replace(rules, rules={condition.rule: rules.rules[condition.rule]}, costs={})
    (found,) = judge(draw(scene(condition, case), "scene", str(condition)), alone).verdicts
    return "vacuous" if found.verdict == "pass" and not found.instances else found.verdict


class _Scene:
    def __init__(self, condition: Condition, case: str) -> None:
        self.deed, *args = condition.action
        self.args, self.case = args, case
        self.parts = list(zip(condition.literals, truths(condition, case), strict=True))
        self.tags: dict[str, list[str]] = {}
        self.names = list(
            dict.fromkeys([*args, *(b for part in condition.literals for b in part.bodies)])
        )
        for place, tags in condition.tags.items():
            kind, number = place.split()
            groups = [args] if kind == "action" else [p.bodies for p in condition.literals]
            for group in groups:
                had = self.tags.setdefault(group[int(number) - 1], [])
                had += [tag for tag in tags if tag not in had]
        self.story: list[str] = []
        self.joints: dict[str, str] = {}
        self.channels: dict[str, set[str]] = {}

    def text(self) -> str:
        """TOML: the story first, since it says which bodies have joints and channels."""
        self.act()
        for part, true in self.parts:
            self.show(part, true)
        done = self.deed == "completion" and self.case != "idle"
        lines = ['says = "A condition."', 'duration = "5 s"', "rate = 10", 'table = "4, 4 m"']
        lines += [f"success = {json.dumps('4 s' if done else 'false')}", "story = ["]
        lines += [f"  {step}," for step in self.story] + ["]"]
        for name, curve in self.joints.items():
            lines += [f"[joints.hinge_{name}]", f'body = "{name}"', 'limits = "0 deg to 90 deg"',
                      f'position = "{curve}"']  # fmt: skip
        for name in self.names:
            lines += self.body(name)
        return "\n".join(lines)

    # ------------------------------------------------------------ actions

    def act(self) -> None:
        happens = self.case != "idle"
        if self.deed in DEEDS:
            channel, place = DEEDS[self.deed]
            off = any(p.predicate == channel and not true for p, true in self.parts)
            # what is asked for at the end is switched off again; what is asked for before is not
            end = "1 at 3.5 s, 0 at 3.6 s" if off else "1 at 5 s"
            self.channel(
                channel, self.args[place], f"0 at 1.9 s, 1 at 2 s, {end}" if happens else "0 at 0 s"
            )
        elif self.deed == "OPEN":
            shut = any(p.predicate == "open" and not true for p, true in self.parts)
            end = "0 deg at 4 s" if shut else "40 deg at 4 s"
            self.joints[self.args[0]] = (
                f"0 deg at 1 s, 60 deg at 2 s, 60 deg at 3 s, {end}" if happens else "0 deg at 0 s"
            )
        elif self.deed.startswith("PLACE") and happens:
            self.carry(self.args[0], self.args[1])

        for body, tags in self.tags.items():
            if "wiped" in tags and self.deed == "WIPE":
                # what else is to be wiped comes next
                self.channel("wiped", body, "0 at 2.9 s, 1 at 3 s" if happens else "0 at 0 s")

    def carry(self, thing: str, place: str) -> None:
        (x, y, low), (to_x, to_y, _) = self.at(thing), self.at(place)
        top = self.inner_floor(place) - low
        self.story += [
            f'{{ hold = "{thing}", during = "1 to 4 s" }}',
            f'{{ move = "{thing}", by = "0, 0, 50 cm", during = "1.4 to 2 s" }}',
            f'{{ move = "{thing}", by = "{to_x - x}, {to_y - y}, 0 cm", during = "2 to 3 s" }}',
            f'{{ move = "{thing}", by = "0, 0, {top - 50} cm", during = "3 to 3.6 s" }}',
        ]

    def channel(self, name: str, body: str, values: str) -> None:
        if name not in self.channels.setdefault(body, set()):
            self.channels[body].add(name)
            self.story.append(f'{{ channel = "{name}", of = "{body}", values = "{values}" }}')

    def show(self, part: Literal, true: bool) -> None:
        body = part.bodies[0]
        if part.predicate == "open":
            self.joints.setdefault(body, "40 deg at 0 s" if true else "0 deg at 0 s")
        elif part.predicate in STATES:
            self.channel(STATES[part.predicate], body, f"{int(true)} at 0 s")

    # ------------------------------------------------------------ bodies

    def hollow(self, name: str) -> bool:
        """Something has to lie in it in this case, or it is asked whether it does and nothing else."""
        into = {p.bodies[1] for p, true in self.parts if p.predicate == "inside"}
        onto = {
            p.bodies[1] for p, true in self.parts if p.predicate in ("ontop", "nextto") and true
        }
        return (name in into and name not in onto) or (
            self.deed == "PLACE_INSIDE" and name == self.args[1]
        )

    def size(self, name: str) -> tuple[float, float, float]:
        if self.hollow(name):
            return 40, 40, 30
        if name in {p.bodies[1] for p, _ in self.parts if len(p.bodies) == 2} | set(self.args[1:2]):
            return 30, 30, 6
        return 8, 8, 8

    def inner_floor(self, name: str) -> float:
        return 1 if self.hollow(name) else self.size(name)[2]

    def at(self, name: str) -> tuple[float, float, float]:
        """Middle of the bottom, cm."""
        for part, true in self.parts:
            if len(part.bodies) == 2 and part.bodies[0] == name and true:
                other = part.bodies[1]
                x, y, z = self.at(other)
                mine = [p.bodies[0] for p, t in self.parts if t and p.bodies[1:] == (other,)]
                if part.predicate == "nextto":
                    return x, y - (self.size(other)[1] + self.size(name)[1]) / 2 - 2, 0
                aside = 10 * mine.index(name) if len(mine) > 1 else 0
                return x + aside, y, z + self.inner_floor(other)
        return (*SPOTS[self.names.index(name)], 0)

    def body(self, name: str) -> list[str]:
        x, y, z = self.size(name)
        wall = " wall 1 cm" if self.hollow(name) else ""
        moved = any(p.bodies[0] == name and len(p.bodies) == 2 for p, _ in self.parts)
        held = self.deed.startswith("PLACE") and name == self.args[0]
        fixed = (name in BUILT_IN and not moved and not held) or (
            self.deed == "OPEN" and name == self.args[0]
        )
        lines = [f"[bodies.{name}]", f'shape = "{"bin" if wall else "box"} {x} x {y} x {z} cm{wall}"',
                 f'at = "{", ".join(map(str, self.at(name)))} cm"',
                 f"tags = {json.dumps(self.tags.get(name, []))}"]  # fmt: skip
        return lines + ['kind = "fixture"'] * fixed
