"""The house as it is drawn in the README: who may know whom, and what no file may say."""

import ast
import re
from collections import Counter
from functools import cache
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).resolve().parents[2]
EVALUATOR, SIMULATOR = "safestage_eval", "simulate"

ROOMS = {
    "safestage_eval": (
        "version",
        "errors",
        "units",
        "palette",  # the colours of every page and plot
        "size_limits",  # how large an episode may be
        "_text",  # JSON and TOML that others wrote
        "_process",  # memory limits, worker processes
        "_serving",  # what stands before every server
        "episode",
        "doubts",  # what cannot be true of a recording
        "formats",
        "geometry",
        "evidence",
        "relations",
        "signals",
        "rules",
        "sketch",  # example scenes of the rules
        "verdicts",
        "metrics",
        "whatif",  # the same traces under other values and other rules
        "run",  # many episodes, in one process, a pool, or on Ray
        "audit",  # are recordings, scenes and evaluations sound?
        "importers",  # other people's files
        "report",
        "viewer",  # pages for a browser
        "label",  # people judge rollouts
        "monitor",  # the same rules while a rollout is going on
        "api",
        "__init__",
        "pytest_plugin",
        "cli",
    ),
    "simulate": (
        "__init__",
        "policy",
        "arm",
        "catalogue",
        "world",
        "looks",  # what only cameras see
        "skills",
        "tasks",
        "cameras",
        "importers",
        "learn",  # policies trained from recordings
        "clients",
        "policies",
        "record",
        "servers",
        "render",
        "study",
        "feasibility",
        "cli",
    ),
}
"""Folders and single files of each package; a file imports from its own room and those above it."""

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


@cache
def imports_of(path):
    return set(imported((CHECKOUT / path).read_text("utf-8"), ".".join(path.parent.parts)))


def modules_imported(path):
    """Modules of the two packages that a file imports, by their dotted names."""
    found = set()
    for name in imports_of(path):
        parts = name.split(".")
        nested = (".".join(parts[:depth]) for depth in range(len(parts), 0, -1))
        found |= {next((module for module in nested if module in MODULES), module_of(path))}
    return found - {module_of(path)}


def module_of(path):
    return ".".join(path.with_suffix("").parts).removesuffix(".__init__")


def rank(module):
    """A module's package, and the place of its room in it."""
    package, *below = module.split(".")
    return package, ROOMS[package].index(below[0] if below else "__init__")


def circles(graph):
    """Strongly connected components of more than one module (Tarjan 1972)."""
    order, low, stack, out = {}, {}, [], []

    def visit(module):
        order[module] = low[module] = len(order)
        stack.append(module)
        for other in sorted(graph.get(module, ())):
            if other not in order:
                visit(other)
            if other in stack:
                low[module] = min(low[module], low[other])
        if low[module] == order[module]:
            at = stack.index(module)
            if len(stack) - at > 1:
                out.append(sorted(stack[at:]))
            del stack[at:]

    for module in graph:
        if module not in order:
            visit(module)
    return out


@pytest.mark.parametrize("package", ROOMS)
def test_every_folder_and_file_is_a_room(package):
    found = {path.parts[1].removesuffix(".py") for path in FILES if path.parts[0] == package}
    assert found == set(ROOMS[package])


@pytest.mark.parametrize("package", ROOMS)
def test_contributing_lists_the_rooms_in_order(package):
    text = (CHECKOUT / "CONTRIBUTING.md").read_text("utf-8")
    section = text.split(f"### {package}", 1)[1].split("\n#", 1)[0]
    cells = re.findall(r"^\| (`[^|]*) \|", section, re.MULTILINE)
    names = [name for cell in cells for name in re.findall(r"`(\w+)(?:/|\.py)`", cell)]
    assert [n for n in names if n != "__init__"] == [n for n in ROOMS[package] if n != "__init__"]


def test_every_file_that_contributing_names_is_there():
    text = (CHECKOUT / "CONTRIBUTING.md").read_text("utf-8")
    links = re.findall(r"\]\(([^)#]+)", text)
    assert len(links) > 12
    assert not [link for link in links if not (CHECKOUT / link).exists()]


def test_no_two_files_have_one_name():
    names = Counter(path.name for path in FILES if path.name != "__init__.py")
    assert not [name for name, count in names.items() if count > 1]


def test_imports_go_one_way():
    for path in FILES:
        package, mine = rank(module_of(path))
        for module in sorted(modules_imported(path)):
            theirs_package, theirs = rank(module)
            if theirs_package == package:
                assert theirs <= mine, f"{path} imports {module}, from a later room"
            else:
                assert package == SIMULATOR, f"{path} imports {module}"


def test_the_evaluator_does_without_mujoco():
    for path in FILES:
        names = {name.split(".")[0] for name in imports_of(path)}
        assert path.parts[0] != EVALUATOR or "mujoco" not in names, path


def test_no_import_circle():
    found = circles({module_of(path): modules_imported(path) for path in FILES})
    assert not found, "\n".join(" ⇄ ".join(circle) for circle in found)


def test_a_file_can_be_read_in_one_sitting():
    lines = {path: len((CHECKOUT / path).read_text("utf-8").splitlines()) for path in FILES}
    assert [path for path, count in lines.items() if count > 600] == []


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
