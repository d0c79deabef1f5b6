"""Diagnostics of the rule checker for a file that is open in an editor."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from safestage_eval._text.plural import count
from safestage_eval.errors import RuleError
from safestage_eval.rules.check import check
from safestage_eval.rules.diagnostic import Diagnostic
from safestage_eval.rules.files import RuleFile, parsed, read_edited

_RULES = re.compile(r"^[ \t]*(?:\[ruleset\]|\[\[(?:rule|cost)\]\])", re.MULTILINE)


def is_rule_file(text: str) -> bool:
    """Whether a TOML file is about rules: editors send those of other programs too."""
    return _RULES.search(text) is not None


def problems_of(path: Path, text: str, texts: Mapping[Path, str]) -> list[Diagnostic]:
    """Everything that is wrong with one file; of those it extends, that they have problems.

    Args:
        path: absolute; the file need not be there.
        text: what it says in the editor.
        texts: those of other open files.
    """
    if not is_rule_file(text):
        return []
    try:
        files, problems, shown = read_edited(path, {**texts, path: text})
    except RuleError as error:  # a file that it extends cannot be opened
        return [Diagnostic(str(path), 1, 1, "R104", f"{error.where}: {error.what}")]
    diagnostics = sorted({*problems, *check(files)})
    own = [one for one in diagnostics if one.path == shown]
    elsewhere = [one for one in diagnostics if one.path != shown]
    if not elsewhere:
        return own
    first = elsewhere[0]
    what = f"{count(len(elsewhere), 'problem')} in what it extends: {first.what}"
    bare = RuleFile(shown, *parsed(text, shown), asked=True)
    inherited = bare.diagnostic(first.code, ("ruleset", "extends"), what, first.allowed, key=False)
    inherited = replace(inherited, fix=f"see {first.path}:{first.line}:{first.column}")
    return sorted([*own, inherited])
