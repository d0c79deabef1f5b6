"""Nothing that is read is ever run, and nothing goes over the network."""

import ast
from pathlib import Path

import safestage_eval

ROOT = Path(safestage_eval.__file__).parent

RUNS_WHAT_IT_READS = {
    "pickle",
    "cPickle",
    "dill",
    "cloudpickle",
    "marshal",
    "shelve",
    "joblib",
    "yaml",
}
STARTS_PROGRAMS = {"subprocess", "pty", "ctypes", "cffi"}
GOES_OUT = {"socket", "ssl", "urllib.request", "http.client", "requests", "httpx", "aiohttp", "ftplib",
            "smtplib", "websockets", "websocket"}  # fmt: skip
CALLS = {"eval", "exec", "compile", "__import__", "execfile", "breakpoint"}
METHODS = {
    ("os", "system"),
    ("os", "popen"),
    ("os", "execv"),
    ("os", "spawnv"),
    ("os", "posix_spawn"),
}

ALLOWED = {
    "_process": {"ctypes", "subprocess"},
    "_serving": {"socket"},
}
"""Folder → modules that it may import: the allocator of C is set to keep what it has; Rerun's own
command merges its files; servers hang up on callers."""


def imported(tree):
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (name.name for name in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            yield node.module
            yield from (f"{node.module}.{name.name}" for name in node.names)


def called(tree):
    for node in ast.walk(tree):
        if not isinstance(node, ast.Call):
            continue
        if isinstance(node.func, ast.Name):
            yield node.func.id
        elif isinstance(node.func, ast.Attribute) and isinstance(node.func.value, ast.Name):
            yield node.func.value.id, node.func.attr
        for keyword in node.keywords:
            if keyword.arg == "allow_pickle":
                yield "allow_pickle"


FILES = sorted(ROOT.rglob("*.py"))


def test_no_way_to_run_or_to_send():
    for file in FILES:
        tree = ast.parse(file.read_text("utf-8"))
        modules = set(imported(tree))
        modules |= {name.partition(".")[0] for name in modules}
        folder = file.relative_to(ROOT).parts[0]
        forbidden = RUNS_WHAT_IT_READS | STARTS_PROGRAMS | GOES_OUT
        assert not modules & forbidden - ALLOWED.get(folder, set()), file
        assert not set(called(tree)) & (CALLS | METHODS | {"allow_pickle"}), file


def test_the_names_are_found():
    text = "import pickle\nfrom urllib import request\nimport os\nos.system('x')\neval('1')\n"
    tree = ast.parse(text)
    assert {"pickle", "urllib.request"} <= set(imported(tree))
    assert {("os", "system"), "eval"} <= set(called(tree))
    assert len(FILES) > 100
