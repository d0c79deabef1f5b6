"""The house as it is drawn in the README: who may know whom, and what no file may say."""

import ast
import re
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).resolve().parents[2]
EVALUATOR, SIMULATOR = "safestage_eval", "simulate"

ROOMS = [
    {
        "errors",
        "json_text",
        "toml_text",
        "units",
        "simulator",
        "compiled",
        "heap",
        "blas",
        "memory",
        "spawned",
        "child",
    },
    {"episode"},
    {"formats"},
    {"geometry"},
    {"evidence"},
    {"relations"},
    {"signals"},
    {"states"},
    {"rules"},
    {"sketch"},  # example scenes of the rules
    {"importers"},  # other people's files
    {"verdicts"},
    {"monitor"},  # the same rules while a rollout is going on
    {"cache"},  # what was measured and judged before
    {"scoring", "engines"},  # the verdicts of many episodes, and where they are reached
    {"metrics"},
    {"whatif"},  # the same traces under other values and other rules
    {"replay"},  # an episode for the eye, drawn in a browser
    {"pages"},  # the look of everything that is shown in a browser
    {"report"},
    {"label"},  # people judge rollouts
    {"api", "pytest_plugin"},
    {"cli"},
]
RANK = {room: rank for rank, rooms in enumerate(ROOMS) for room in rooms}

FILES = sorted(
    path.relative_to(CHECKOUT)
    for package in (EVALUATOR, SIMULATOR)
    for path in (CHECKOUT / package).rglob("*.py")
)
MODULES = {".".join(path.with_suffix("").parts).removesuffix(".__init__") for path in FILES}

MACHINE_PATHS = re.compile(r"(?<![\w.])/(?:work|opt|root|home)/|\.\./shared")
TEXTS = {"", ".json", ".md", ".proto", ".py", ".toml", ".txt", ".yaml", ".yml"}
NOT_OURS = {".git", ".hypothesis", ".mypy_cache", ".pytest_cache", ".ruff_cache", ".venv"}
NOT_OURS |= {"__pycache__", "build", "dist"}


def imported(source, package):
    """Modules that a file imports, wherever in the file, as absolute dotted names."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                above = package.split(".")
                above = above[: len(above) - node.level + 1]
                base = ".".join([*above, *([base] if base else [])])
            for alias in node.names:
                whole = f"{base}.{alias.name}"
                yield whole if whole in MODULES else base


def imports_of(path):
    return set(imported((CHECKOUT / path).read_text("utf-8"), ".".join(path.parent.parts)))


def room(module):
    """The room of a module of the evaluator; None for the package itself."""
    parts = module.split(".")
    return parts[1] if len(parts) > 1 else None


@pytest.mark.parametrize(
    ("line", "found"),
    [
        ("import mujoco.viewer as v", {"mujoco.viewer"}),
        ("def f():\n    from safestage_eval.rules import load", {"safestage_eval.rules.load"}),
        ("from .body import Body", {"safestage_eval.episode.body"}),
        ("from . import body", {"safestage_eval.episode.body"}),
        ("from ..formats import load", {"safestage_eval.formats"}),
        ("from .. import units", {"safestage_eval.units"}),
    ],
)
def test_imports_are_seen(line, found):
    assert set(imported(line, "safestage_eval.episode")) == found


@pytest.mark.parametrize("path", [p for p in FILES if p.parts[0] == EVALUATOR], ids=str)
def test_data_flows_one_way(path):
    mine = room(".".join(path.with_suffix("").parts))
    if mine == "__init__":
        mine = "api"  # the package's face
    assert mine in RANK, f"{mine} is no room of the house"
    for module in imports_of(path):
        top = module.split(".", maxsplit=1)[0]
        assert top not in {"mujoco", SIMULATOR}, f"{path} imports {module}"
        if top == EVALUATOR and room(module) is not None:
            theirs = room(module)
            assert RANK[theirs] <= RANK[mine], f"{path} imports {module}, from a later room"


@pytest.mark.parametrize("path", FILES, ids=str)
def test_a_file_can_be_read_in_one_sitting(path):
    assert len((CHECKOUT / path).read_text("utf-8").splitlines()) <= 450


def test_no_file_depends_on_one_machine():
    found = []
    for path in sorted(CHECKOUT.rglob("*")):
        inside = path.relative_to(CHECKOUT)
        if NOT_OURS & {*inside.parts} or not path.is_file() or path.suffix not in TEXTS:
            continue
        if path == Path(__file__).resolve():
            continue
        for number, line in enumerate(path.read_text("utf-8", "replace").splitlines(), 1):
            if MACHINE_PATHS.search(line):
                found.append(f"{inside}:{number}: {line.strip()[:100]}")
    assert not found, "\n".join(found)
