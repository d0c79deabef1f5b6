"""Values of parameters as they are set on the command line, in headers and in bind files."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from safestage_eval.errors import RuleError, did_you_mean

from . import string_parser
from . import syntax as ast
from .names import a_dimension, dimension_of


def parse_overrides(rules: ast.RuleSet, overrides: Mapping[str, str]) -> dict[str, ast.Setting]:
    """``{"edge": "3 cm"}`` → values, checked against the parameters' dimensions.

    Raises:
        RuleError: an unknown parameter, no quantity, the wrong dimension.
    """
    return {
        name: setting(rules, name, text, f"--set {name}={text}") for name, text in overrides.items()
    }


def setting(rules: ast.RuleSet, name: str, text: Any, where: str) -> ast.Setting:
    """A value as somebody wrote it, checked against the parameter's dimension. Raises RuleError."""
    if name not in rules.params:
        raise RuleError(
            where,
            f'no loaded rule file has a parameter "{name}".',
            ", ".join(sorted(rules.params)),
            did_you_mean(name, rules.params),
        )
    wanted = dimension_of(rules.params[name])
    allowed = f"{a_dimension(wanted)}; its default is {rules.params[name].text}"
    try:
        value = string_parser.setting(text)
    except string_parser.GrammarError as problem:
        raise RuleError(where, f"{problem.what}.", allowed) from None
    given = dimension_of(value)
    if wanted != given:
        bare = re.search("[a-z%°]", str(text), re.IGNORECASE) is None
        raise RuleError(
            where,
            f'{name} is in {wanted}, but "{text}" {"has no unit" if bare else f"is in {given}"}.',
            allowed,
        )
    return value
