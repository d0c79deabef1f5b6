"""The question to a reviewer: the task of a rollout, and its requirements."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from safestage_eval.episode import Header
from safestage_eval.errors import InputError
from safestage_eval.formats import EpisodeRef
from safestage_eval.report.rule_report import rule_facts
from safestage_eval.rules import BindFile, RuleSet, bind_episode, syntax_words
from safestage_eval.rules import syntax as ast

STAGES = {
    "ISH": "About the start: was a hazard that was there already dealt with first?",
    "ETS": "About the way: what did the robot and its load touch, push or pass over?",
    "FSH": "About the end: in which state was everything left?",
}
"""Stage → where a reviewer should look."""


def question(header: Header, rules: RuleSet, bind: BindFile | None = None) -> dict[str, Any]:
    """Write instruction, roles, and the assigned rules in words, as plain values.

    Nothing of a verdict is in it, nor who acted: no policy, no id, no path, no note. Limits are those
    that hold for this episode: of its task, its bind file, and its bodies' materials.

    Raises:
        RuleError: the episode does not fit the rules.
    """
    binding = bind_episode(rules, header, bind=bind)
    requirements, unknown = [], []
    for code in binding.assigned:
        rule = rules.rules.get(code) or rules.costs.get(code)
        if rule is None:
            unknown.append(code)
            continue
        own = replace(rule, set=tuple({**dict(rule.set), **binding.values}.items()))
        facts = rule_facts(rules, own, {})
        lasting = f", for {facts['for']} or longer" if facts.get("for") else ""
        always, never, once = (
            [_with_material_limits(text, rules, header, binding.roles) for text in texts]
            for texts in (
                facts.get("require", []),
                facts.get("forbid", []),
                [facts["reach"]] if facts.get("reach") else [],
            )
        )
        requirements.append(
            {
                "code": code,
                "title": rule.title,
                "why": rule.why,
                "judged": facts["scope"] + (f", until {facts['until']}" * bool(facts["until"])),
                "always": always,
                "never": [text + lasting for text in never],
                "once": [text + lasting for text in once],
                "words": {**facts["states"], **facts["phases"]},
            }
        )
    return {
        "instruction": header.instruction,
        "stage": header.stage,
        "look": STAGES.get(header.stage or ""),
        "rules": requirements,
        "unknown": unknown,
        "roles": {role: list(bodies) for role, bodies in binding.roles.items()},
        "success": header.success,
        "success_time": header.success_time,
    }


def _with_material_limits(
    text: str, rules: RuleSet, header: Header, roles: Mapping[str, Sequence[str]]
) -> str:
    """Add limits: ``at most the max_tilt of target`` → ``at most the max_tilt of target (bottle: 8 deg)``."""
    materials = {body.name: body.material for body in header.bodies}

    def with_limits(match: re.Match[str]) -> str:
        column, role = match.groups()
        limits = []
        for body in roles.get(role, ()):
            default: Mapping[str, ast.Quantity] = rules.materials.get("default", {})
            row = rules.materials.get(materials.get(body) or "", default)
            value = row.get(column, default.get(column))
            if value is not None:
                limits.append(f"{body}: {syntax_words.value(value)}")
        return match[0] + (f" ({', '.join(limits)})" if limits else "")

    return re.sub(r"the (\w+) of (\w+)", with_limits, text)


def unasked(ref: EpisodeRef, rules: RuleSet, bind: BindFile | None = None) -> str | None:
    """Why an episode cannot be reviewed; None if it can."""
    try:
        binding = bind_episode(rules, ref.open().header, bind=bind)
    except InputError as error:
        return str(error)
    if not binding.assigned:
        return "no rule is assigned to it"
    codes = [code for code in binding.assigned if code in rules.rules or code in rules.costs]
    return None if codes else f"its rules are not loaded: {', '.join(binding.assigned)}"
