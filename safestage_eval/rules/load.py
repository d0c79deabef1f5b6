"""Rule files in, one checked rule set out."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

from . import syntax as ast
from .check import check, read
from .diagnostic import Diagnostic, RuleErrors
from .files import RuleFile, read_files


def load_rules(specs: Sequence[str | Path]) -> ast.RuleSet:
    """Read, check and merge rule files.

    The files are read each time; as long as none of them changed, the same rule set comes back.

    Args:
        specs: paths of files or folders, or built-in names (``["fsh"]``, ``["rules/"]``).

    Raises:
        RuleErrors: with every diagnostic of every file at once.
        RuleError: a spec stands for no file, or a file cannot be opened.
    """
    files, problems = read_files(specs)
    if problems:
        raise RuleErrors(problems + check(files))
    problems, rules = _read(tuple(files))
    if problems:
        raise RuleErrors(problems)
    return rules


_read = lru_cache(maxsize=32)(read)


def merge(files: Sequence[RuleFile]) -> ast.RuleSet:
    """One rule set of checked files; a later definition of a name replaces an earlier one."""
    return read(files)[1]


def check_rules(specs: Sequence[str | Path]) -> list[Diagnostic]:
    """Everything that is wrong with rule files, in the order of files and lines; best empty.

    Args:
        specs: paths of files or folders, or built-in names.

    Raises:
        RuleError: a spec stands for no file, or a file cannot be opened.
    """
    files, problems = read_files(specs)
    return sorted(problems + check(files))
