"""Rules by their code, or by the file that holds them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from safestage_eval.errors import RuleError, did_you_mean

from . import syntax as ast
from .diagnostic import RuleErrors
from .files import all_names, builtin_names, find
from .load import load_rules
from .tables import CODE
from .uses import Source, sources

Found = tuple[ast.RuleSet, ast.Scoped, dict[str, Source]]
"""A rule or cost, the set it belongs to, and where the values of that set stand."""


def find_rules(wanted: Iterable[str], specs: Sequence[str | Path] = ()) -> list[Found]:
    """The rules that codes (``ETS201``) and files stand for, in that order.

    Args:
        wanted: codes, paths, folders or built-in names.
        specs: where codes are looked for; in all built-in files if empty.

    Raises:
        RuleError: no such rule or file, or a file that is not sound.
    """
    rules_found: list[Found] = []
    for name in wanted:
        if re.fullmatch(CODE, name) and not Path(name).exists():
            rules_found.append(_by_code(name, specs))
            continue
        try:
            rules = load_rules([name])
        except RuleError as error:
            if error.where != name or isinstance(error, RuleErrors):
                raise
            names = ", ".join(all_names())
            near = did_you_mean(name.upper(), [code for code, *_ in list_rules(specs)])
            raise RuleError(
                name,
                "no such rule or rule file.",
                f"a code as in ETS201, a file, or a built-in name: {names}",
                near
                or did_you_mean(name, builtin_names())
                or "safestage rules show lists all codes",
            ) from None
        origins = sources([name])
        rules_found += [(rules, rule, origins) for rule in rules.scoped.values()]
    return rules_found


def list_rules(specs: Sequence[str | Path] = ()) -> list[tuple[str, str, str]]:
    """Code, title and file of every rule; of all built-in files if ``specs`` is empty."""
    return [
        (rule.code, rule.title, rule.path)
        for group in groups(specs)
        for rule in load_rules(group).scoped.values()
    ]


def _by_code(code: str, specs: Sequence[str | Path]) -> Found:
    codes = []
    for group in groups(specs):
        rules = load_rules(group)
        if code in rules.scoped:
            return rules, rules.scoped[code], sources(group)
        codes += list(rules.scoped)
    where = ", ".join(map(str, specs)) or "the built-in rules"
    alike = [other for other in codes if other[:3] == code[:3].upper()]
    raise RuleError(
        code,
        f"no such rule in {where}.",
        ", ".join(alike or codes),
        did_you_mean(code, codes)
        or "safestage rules show lists them all; --rules FILE names the file that declares it",
    )


def groups(specs: Sequence[str | Path], *, each: bool = False) -> list[list[str | Path]]:
    """The specs to read together: all that were given, or each built-in file by itself.

    With ``each``, what was asked for is not read together either.

    Raises RuleError for a spec that stands for no file.
    """
    if specs:
        for spec in specs:
            find(spec)
        return [[spec] for spec in specs] if each else [list(specs)]
    return [[name] for name in all_names()]
