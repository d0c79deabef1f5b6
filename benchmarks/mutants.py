"""Do the tests notice when the core is wrong? Small faults, each tried against the tests.

    python benchmarks/mutants.py --count 300 --jobs 16            # survivors at the end
    python benchmarks/mutants.py --count 20 --seed 5 --rooms verdicts

A fault changes one place of the code: a comparison, a sign, ``and`` into ``or``, ``min`` into ``max``,
a number by one, ``not`` away. It is killed when a test fails, or when the tests take longer than
``--patience`` times what they take without a fault. First ``pytest --quick`` of the rooms
that make verdicts is asked (about 80 s), then, of what survives, all of their tests (some minutes).
Every job works in a copy of its own.
"""

from __future__ import annotations

import argparse
import ast
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import SimpleQueue
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
ROOMS = ("verdicts", "signals", "relations", "evidence")
TESTS = ("verdicts", "relations", "signals", "evidence", "rules", "test_goldens.py")
"""In the order in which they are asked: those that fail soonest first."""
OPERATORS: dict[type[ast.AST], str] = {
    ast.Lt: "<=", ast.LtE: "<", ast.Gt: ">=", ast.GtE: ">", ast.Eq: "!=", ast.NotEq: "==",
    ast.Is: "is not", ast.IsNot: "is", ast.In: "not in", ast.NotIn: "in",
    ast.Add: "-", ast.Sub: "+", ast.Mult: "/", ast.Div: "*", ast.BitAnd: "|", ast.BitOr: "&",
    ast.And: "or", ast.Or: "and",
}  # fmt: skip
NAMES = {
    "minimum": "maximum", "maximum": "minimum", "min": "max", "max": "min", "any": "all",
    "all": "any", "lower": "upper", "upper": "lower", "argmin": "argmax", "argmax": "argmin",
    "flatnonzero": "ravel", "logical_and": "logical_or", "logical_or": "logical_and",
}  # fmt: skip


class Fault(NamedTuple):
    """One place of a file with another text."""

    file: str
    line: int
    begin: int
    end: int
    was: str
    becomes: str

    def __str__(self) -> str:
        return f"{self.file}:{self.line}: {self.was!r} -> {self.becomes!r}"


def faults(path: Path) -> Iterator[Fault]:
    """All faults of a file; none in annotations, docstrings and type declarations."""
    source = path.read_text()
    starts = [0]
    for text in source.splitlines(keepends=True):
        starts.append(starts[-1] + len(text.encode()))
    raw, file = source.encode(), str(path.relative_to(ROOT))

    def place(node: ast.expr) -> tuple[int, int]:
        assert node.end_lineno is not None and node.end_col_offset is not None
        return (
            starts[node.lineno - 1] + node.col_offset,
            starts[node.end_lineno - 1] + node.end_col_offset,
        )

    def fault(begin: int, end: int, becomes: str) -> Fault:
        line = raw[:begin].count(b"\n") + 1
        return Fault(file, line, begin, end, raw[begin:end].decode(), becomes)

    def between(left: ast.expr, right: ast.expr, kind: ast.AST) -> Iterator[Fault]:
        """The operator that stands between two operands."""
        begin, end = place(left)[1], place(right)[0]
        text = raw[begin:end].decode()
        if type(kind) in OPERATORS and "#" not in text:
            word = text.strip(" ()\n")
            at = begin + text.index(word)
            if word and word.isascii():
                yield fault(at, at + len(word), OPERATORS[type(kind)])

    def walk(node: ast.AST) -> Iterator[Fault]:
        if isinstance(node, ast.Compare):
            operands = [node.left, *node.comparators]
            for left, kind, right in zip(operands, node.ops, operands[1:], strict=False):
                yield from between(left, right, kind)
        elif isinstance(node, ast.BinOp):
            yield from between(node.left, node.right, node.op)
        elif isinstance(node, ast.BoolOp):
            for left, right in zip(node.values, node.values[1:], strict=False):
                yield from between(left, right, node.op)
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not | ast.Invert | ast.USub):
            begin, inner = place(node)[0], place(node.operand)[0]
            if raw[begin:inner].strip() in (b"not", b"~", b"-"):
                yield fault(begin, inner, "")
        elif isinstance(node, ast.Constant) and isinstance(node.value, int | float):
            becomes = not node.value if isinstance(node.value, bool) else node.value + 1
            yield fault(*place(node), repr(becomes))
        elif isinstance(node, ast.Attribute) and node.attr in NAMES:
            end = place(node)[1]
            yield fault(end - len(node.attr), end, NAMES[node.attr])
        elif isinstance(node, ast.Name) and node.id in NAMES and isinstance(node.ctx, ast.Load):
            yield fault(*place(node), NAMES[node.id])
        for name, value in ast.iter_fields(node):
            if name in ("annotation", "returns", "decorator_list", "type_params"):
                continue
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.AST):
                    yield from walk(child)

    for node in ast.parse(source).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef | ast.Assign):
            yield from walk(node)


def killed(copy: Path, *options: str, limit: float | None) -> bool:
    """Whether the tests fail in a copy of the tree."""
    paths = [str(copy / "tests" / name) for name in TESTS]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(copy), *sys.path[1:]])}
    words = ["-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", "-p", "no:xdist"]
    command = [sys.executable, *words]
    try:
        done = subprocess.run(
            [*command, *options, *paths], cwd=copy, env=environment, timeout=limit, check=False,
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return True
    return done.returncode != 0


def main(arguments: Sequence[str] | None = None) -> int:
    """Try faults; returns 1 where fewer are killed than wanted."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=300, help="number of faults")
    parser.add_argument("--seed", type=int, default=0, help="which faults")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--rooms", nargs="+", default=ROOMS, help="rooms that faults are made in")
    parser.add_argument("--patience", type=float, default=4.0)
    parser.add_argument("--wanted", type=float, default=0.85, help="share that is to be killed")
    options = parser.parse_args(arguments)
    files = [
        f for room in options.rooms for f in sorted((ROOT / "safestage_eval" / room).rglob("*.py"))
    ]
    found = [fault for file in files for fault in faults(file)]
    tried = random.Random(options.seed).sample(found, min(options.count, len(found)))
    print(f"{len(tried)} of {len(found)} faults in {len(files)} files", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        copies: SimpleQueue[Path] = SimpleQueue()
        for job in range(options.jobs):
            copy = Path(folder, str(job), ROOT.name)
            away = shutil.ignore_patterns(".git", ".venv", ".*_cache", "__pycache__")
            shutil.copytree(ROOT, copy, ignore=away, symlinks=True)
            copies.put(copy)
        sound = copies.get()
        start = time.monotonic()
        if killed(sound, "--quick", limit=None):
            raise SystemExit("the tests fail without a fault")
        quick = options.patience * max(time.monotonic() - start, 10.0)
        copies.put(sound)

        def outcome(fault: Fault) -> bool:
            copy = copies.get()
            path = copy / fault.file
            whole = path.read_bytes()
            try:
                path.write_bytes(whole[: fault.begin] + fault.becomes.encode() + whole[fault.end :])
                dead = killed(copy, "--quick", limit=quick) or killed(copy, limit=20 * quick)
            finally:
                path.write_bytes(whole)
                copies.put(copy)
            print("killed  " if dead else "SURVIVED", fault, flush=True)
            return dead

        with ThreadPoolExecutor(options.jobs) as pool:
            outcomes = list(pool.map(outcome, tried))
    share = sum(outcomes) / len(outcomes)
    print(
        f"{sum(outcomes)} of {len(outcomes)} killed: {share:.0%}; {options.wanted:.0%} are wanted"
    )
    return int(share < options.wanted)


if __name__ == "__main__":
    sys.exit(main())
