"""Formulas of RTAMT as signals, states and rules, and their values on recorded scalars."""

from __future__ import annotations

import itertools
import re
import sys
import tomllib
from pathlib import Path
from typing import Any

import numpy as np

sys.path.append(str(Path(__file__).resolve().parents[2] / "tests" / "helpers"))

from scenes import Scene
from transforms import rebuilt

from safestage_eval.evidence.measure import Signals
from safestage_eval.relations.relations import Relations
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.check import check
from safestage_eval.rules.load import RuleFile, merge
from safestage_eval.verdicts.evaluate import Evaluator
from safestage_eval.verdicts.instance_verdict import judge_instance

RATE = 100.0
"""Hz: the samples of a formula are 10 ms apart."""


class CannotSayError(Exception):
    """A formula, or a test, for which the language has no words; why."""


TOKEN = re.compile(r"\s*(\d+\.?\d*|[A-Za-z_]\w*|!==|==|<=|>=|->|[-+*/()<>\[\],:=;])")
PAST = {"once": "once", "historically": "always"}
FUTURE = ("always", "eventually", "next", "s_next")
UNSAID = {
    "sqrt": "a root is no operation of signals", "exp": "an exponential is no operation of signals",
    "pow": "a power is no operation of signals", "/": "a quotient is no operation of signals",
}  # fmt: skip


ARITHMETIC = {"+": "sum", "-": "difference", "*": "product", "/": "/", "abs": "abs", "sqrt": "sqrt",
              "exp": "exp", "pow": "pow"}  # fmt: skip


class Formula:
    """One formula as TOML: its value is that of a signal, the margin of a state, or of a rule."""

    def __init__(self, text: str, constants: dict[str, float]) -> None:
        if ";" in text or text.count(" = ") > 1:
            raise CannotSayError("has several outputs: a rule has one verdict")
        body = text.partition(" = ")[2] or text
        self._tokens = TOKEN.findall(body)
        if "".join(self._tokens) != re.sub(r"\s", "", body):
            raise CannotSayError(f"is not understood: {text}")
        self._at, self._constants, self._count = 0, constants, itertools.count()
        self.variables: set[str] = set()
        self.parts: list[str] = []
        self.rule, self.value = "", ""
        node = self._binary(0)
        if self._at < len(self._tokens):
            raise CannotSayError(f"is not understood: {text}")
        self._say(node)

    # the grammar: weakest first
    LEVELS = (("iff", "xor"), ("->", "implies"), ("or",), ("and",), ("since", "until"),
              ("<=", "<", ">=", ">", "==", "!=="), ("+", "-"), ("*", "/"))  # fmt: skip

    def _binary(self, level: int) -> Any:
        if level == len(self.LEVELS):
            return self._unary()
        left = self._binary(level + 1)
        while self._peek() in self.LEVELS[level]:
            operator = self._next()
            bounds = self._bounds() if operator in ("since", "until") else None
            left = (operator, bounds, left, self._binary(level + 1))
        return left

    def _unary(self) -> Any:
        token = self._next()
        if token in (*PAST, *FUTURE, "not", "prev", "s_prev"):
            return token, self._bounds(), self._unary()
        if token in ("rise", "fall", "abs", "sqrt", "exp", "pow"):
            self._next()
            inner = [self._binary(0)]
            while self._next() == ",":
                inner.append(self._binary(0))
            return (token, None, *inner)
        if token == "(":
            inside = self._binary(0)
            self._next()
            return inside
        if token == "-" and self._peek()[:1].isdigit():
            return -float(self._next())
        if token[0].isdigit():
            return float(token)
        return self._constants.get(token, token)

    def _bounds(self) -> tuple[int, int] | None:
        if self._peek() != "[":
            return None
        self._next()
        first = self._next()
        self._next()
        second = self._next()
        if self._next() != "]" or not (first + second).isdigit():
            raise CannotSayError("has bounds with units of time")
        return int(first), int(second)

    def _peek(self) -> str:
        return self._tokens[self._at] if self._at < len(self._tokens) else ""

    def _next(self) -> str:
        token = self._peek()
        if not token:
            raise CannotSayError("is not understood")
        self._at += 1
        return token

    # ---- saying it

    def _say(self, node: Any) -> None:
        if isinstance(node, tuple) and node[0] in (*FUTURE, "until"):
            self.rule = self._ahead(node)
        elif isinstance(node, str) or (isinstance(node, tuple) and node[0] in ARITHMETIC):
            self.value = self._signal(node)
        elif isinstance(node, float):
            raise CannotSayError("is a constant: a rule is about something measured")
        else:
            self.value = self._state(node)

    def _ahead(self, node: Any) -> str:
        """A rule that says of the first sample what a formula about later ones does."""
        operator, bounds, *inner = node
        first, last = (1, 1) if operator in ("next", "s_next") else bounds or (0, None)
        during = "" if last is None else f'during = "first {last + 1} frames of episode"\n'
        there = f'"once[{first} frames, {first} frames] {self._ever()}"'
        if operator in ("always", "next"):
            what = f'any = [{{ {there} = false }}, "{self._state(inner[0])}"]'
            return f"{during}require = {{ {what} }}\n"
        reached = f'"{self._state(inner[-1])}" = true, {there} = true'
        if operator == "until":
            reached += f', "always[1 frames] {self._state(inner[0])}" = true'
        return f"{during}reach = {{ {reached} }}\n"

    def _ever(self) -> str:
        self.variables.add("anything")
        return self._add_state('"anything(a)" = ">= 0"')

    def _signal(self, node: Any) -> str:
        if isinstance(node, str):
            self.variables.add(node)
            return f"{node}(a)"
        operator, _, *inner = node
        if operator in UNSAID:
            raise CannotSayError(UNSAID[operator])
        if operator not in ARITHMETIC:
            raise CannotSayError("calculates with the robustness of a formula")
        operands = [one if isinstance(one, float) else f'"{self._signal(one)}"' for one in inner]
        name = f"computed_{next(self._count)}"
        listed = ", ".join(f"{one:f}" if isinstance(one, float) else one for one in operands)
        self.parts.append(f'[signal.{name}]\nof = ["a"]\n{ARITHMETIC[operator]} = [{listed}]\n')
        return f"{name}(a)"

    def _state(self, node: Any) -> str:
        if isinstance(node, float):
            raise CannotSayError("is a constant: a rule is about something measured")
        if isinstance(node, str) or node[0] in ARITHMETIC:
            return self._add_state(f'"{self._signal(node)}" = ">= 0"')
        operator, bounds, *inner = node
        if operator in ("<=", "<", ">=", ">", "==", "!=="):
            return self._compared(operator, *inner)
        if operator in ("iff", "xor"):  # RTAMT's are about the size of the difference
            return self._compared("==" if operator == "iff" else "!==", *inner)
        if operator in FUTURE or operator == "until":
            raise CannotSayError("looks ahead inside of a formula: states look back")
        said = [self._state(one) for one in inner]
        if operator == "and":
            return self._add_state(", ".join(f'"{one}" = true' for one in dict.fromkeys(said)))
        if operator == "or":
            return self._add_state(f'any = ["{said[0]}", "{said[1]}"]')
        if operator in ("->", "implies"):
            return self._add_state(f'any = [{{ "{said[0]}" = false }}, "{said[1]}"]')
        if operator == "not":
            return self._add_state(f'"{said[0]}" = false')
        if operator in ("rise", "fall"):
            now = str(operator == "rise").lower()
            before = f'"{"once" if operator == "rise" else "always"}[1 frames, 1 frames] {said[0]}"'
            then = str(operator == "fall").lower()
            return self._add_state(f'"{said[0]}" = {now}, {before} = {then}')
        if operator in ("prev", "s_prev"):
            how = "always" if operator == "prev" else "once"
            return self._add_state(f'"{how}[1 frames, 1 frames] {said[0]}" = true')
        inside = "[0 frames]" if bounds is None else "[{} frames, {} frames]".format(*bounds)
        if operator == "since":
            return self._add_state(f'"{said[0]} since{inside} {said[1]}" = true')
        return self._add_state(f'"{PAST[operator]}{inside} {said[0]}" = true')

    def _compared(self, operator: str, left: Any, right: Any) -> str:
        """Difference and 0; both sides as they are, however they were made."""
        difference = ("-", None, left, right)
        if operator in ("==", "!=="):
            difference = ("abs", None, difference)
        limit = {"==": "<=", "!==": ">"}.get(operator, operator)
        return self._add_state(f'"{self._signal(difference)}" = "{limit} 0"')

    def _add_state(self, when: str) -> str:
        name = f"state_{next(self._count)}"
        self.parts.append(f'[state.{name}]\nof = ["a"]\nwhen = {{ {when} }}\n')
        return f"{name}(a)"

    @property
    def text(self) -> str:
        """The rule file."""
        head = '[ruleset]\nformat = 1\nname = "rtamt"\nversion = "1"\n'
        for name in sorted(self.variables):
            head += f'[signal.{name}]\nbase = "channel"\nchannel = "{name}"\n'
        rule = self.rule
        if not rule:
            limit = f'"{self.value}" = ">= 0"' if self.is_signal else f'"{self.value}" = true'
            rule = f"require = {{ {limit} }}\n"
        start = '[[rule]]\ncode = "RTA101"\ntitle = "t"\nroles = { a = "object" }\n'
        return head + "".join(self.parts) + start + rule

    @property
    def is_signal(self) -> bool:
        """Its value is that of a signal, not a margin."""
        return not self.value.startswith("state_")


# ---- the values that the language gives


def values(formula: Formula, samples: dict[str, list[Any]]) -> list[float]:
    """Values of the formula at every sample."""
    file = RuleFile("rtamt.toml", formula.text, tomllib.loads(formula.text), asked=True)
    problems = check([file])
    if problems:
        raise AssertionError(f"{problems[0].what}\n{formula.text}")
    rules = merge([file])
    frames = max(map(len, samples.values()))
    if not formula.rule:
        evaluator = _evaluator(rules, samples, frames, 0)
        rule = rules.rules["RTA101"]
        assert rule.require is not None
        (atom,) = rule.require.atoms
        if isinstance(atom, ast.SignalAtom):
            return evaluator.series(atom, {"a": "a"}).value.tolist()
        return evaluator.condition(rule.require, {"a": "a"}).lower.tolist()
    found = []
    for first in range(frames):  # of each sample, as the first of a trace
        evaluator = _evaluator(rules, samples, frames, first)
        (instance,) = judge_instance(evaluator, rules.rules["RTA101"], {"a": "a"}) or ()
        found.append(instance.lower)
    return found


def _evaluator(rules: Any, samples: dict[str, list[Any]], frames: int, first: int) -> Evaluator:
    scene = Scene(frames - first, RATE).box("a", 0.05, (0, 0, 1))
    given = {**samples, "anything": [1e12] * frames}
    channels = {("a", n): np.asarray(v[first:], np.float64) for n, v in given.items()}
    episode = rebuilt(scene.episode(), channels=channels)
    return Evaluator(Relations(Signals(episode)), rules, rules.params, None)
