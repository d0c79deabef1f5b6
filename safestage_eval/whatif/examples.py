"""Find the examples that a rule names, judge them, and compare the verdicts with the expected ones."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from safestage_eval import sketch
from safestage_eval.episode import Episode
from safestage_eval.errors import InputError
from safestage_eval.formats import EpisodeRef, load
from safestage_eval.rules import RuleSet
from safestage_eval.rules import syntax as ast
from safestage_eval.verdicts.verdict import Verdict

from .judge_again import Again

Expected = Literal["violation", "pass", "vacuous", "inconclusive"]

FOLDER = "examples"
"""Beside a rule file: its sketches and traces."""


@dataclass(frozen=True)
class Checked:
    """One example of one rule.

    Attributes:
        rule: code.
        name: as the rule file names it.
        expected: the verdict that it must get.
        verdict: the one that it gets; None where the example could not be judged.
        problem: why it could not.
    """

    rule: str
    name: str
    expected: Expected
    verdict: Verdict | None = None
    problem: str = ""

    @property
    def got(self) -> str:
        """The verdict, or ``error``; ``vacuous`` where that is expected and the case."""
        return outcome(self.verdict, self.expected) if self.verdict is not None else "error"

    @property
    def right(self) -> bool:
        """It came out as expected."""
        return self.got == self.expected

    @property
    def why(self) -> str:
        """The explanation of the verdict, or the problem, in a sentence."""
        if self.verdict is None:
            return self.problem
        return self.verdict.explanation or "; ".join(self.verdict.notes)


@dataclass(frozen=True)
class Suite:
    """All examples of a rule set.

    Attributes:
        checked: in the order of the rules.
        lacking: code → how many violating and passing examples it has, where those are too few.
        least: how many of each are required.
    """

    checked: tuple[Checked, ...]
    lacking: dict[str, tuple[int, int]]
    least: int

    @property
    def passed(self) -> bool:
        """Every example came out as expected, and no rule has too few."""
        return not self.lacking and all(item.right for item in self.checked)


class Library:
    """Opens the examples that rules name; each is opened and measured once."""

    def __init__(self, recorded: Iterable[EpisodeRef] = ()) -> None:
        """``recorded``: stored episodes that examples may name by their ids."""
        self._recorded = {ref.episode_id: ref for ref in recorded}
        self._opened: dict[tuple[str, str], Episode] = {}
        self._judged: dict[tuple[str, str], Again] = {}
        """By the rule set that was tried last: its measurements serve the next."""
        self._right: dict[tuple[int, str], tuple[RuleSet, list[tuple[str, Expected]]]] = {}

    def episode(self, name: str, rule: ast.Scoped) -> Episode:
        """The episode that a rule calls by a name.

        Looked for as a trace file beside the rule file, then in its folder ``examples`` (a sketch
        ``NAME.toml`` or a trace ``NAME.mcap``), among the given traces by id, and among the
        built-in sketches.

        Raises:
            InputError: there is none, or it cannot be read.
        """
        key = (str(Path(rule.path).parent), name)
        if key not in self._opened:
            self._opened[key] = self._open(name, Path(rule.path).parent)
        return self._opened[key]

    def _open(self, name: str, folder: Path) -> Episode:
        for path in (folder / name, folder / FOLDER / name, folder / FOLDER / f"{name}.mcap"):
            if path.suffix == ".mcap" and path.is_file():
                return load(path)
        beside = folder / FOLDER
        if name in self._recorded and not (beside / f"{name}.toml").is_file():
            return self._recorded[name].open()
        try:
            return sketch.resolve(name, [beside])
        except sketch.SketchError:
            raise
        except InputError as error:
            if not error.what.startswith("no example"):
                raise
            raise InputError(
                name,
                "no such example.",
                f"a sketch {name.partition('(')[0]}.toml or a trace {name}.mcap in {beside}, "
                "a built-in sketch, or the id of an episode in --traces",
            ) from None

    def judge(self, name: str, rules: RuleSet, rule: ast.Scoped) -> Verdict:
        """Judge an example by a rule, or a cost with a budget.

        Raises InputError as ``episode`` does, or where roles and trace do not fit.
        """
        key = (str(Path(rule.path).parent), name)
        again = Again(self.episode(name, rule), rules, like=self._judged.get(key))
        self._judged[key] = again
        return again.usual(rule)

    def right(self, rules: RuleSet, rule: ast.Scoped) -> list[tuple[str, Expected]]:
        """The examples of a rule that come out as they should; each is judged once per rule set."""
        key = (id(rules), rule.code)
        if key not in self._right:
            examples = [
                (name, expected)
                for name, expected in examples_of(rule)
                if self.comes_out(rules, rule.code, name, expected)
            ]
            self._right[key] = (
                rules,
                examples,
            )  # with the set, or another one might get its identity
        return self._right[key][1]

    def comes_out(self, rules: RuleSet, code: str, name: str, expected: Expected) -> bool:
        """An example is there, can be judged and gets the verdict that is expected of it."""
        try:
            return outcome(self.judge(name, rules, rules.scoped[code]), expected) == expected
        except InputError:
            return False


def deciding(rules: RuleSet) -> dict[str, ast.Scoped]:
    """Code → rules, and costs with a budget: those that need examples."""
    return {
        code: rule
        for code, rule in rules.scoped.items()
        if isinstance(rule, ast.Rule) or rule.budget is not None
    }


def outcome(verdict: Verdict, expected: Expected) -> str:
    """The verdict, or ``vacuous`` where that is expected and the case.

    A pass may be vacuous; what is expected to be vacuous must be.
    """
    vacuous = expected == "vacuous" and verdict.vacuity is not None
    return "vacuous" if vacuous else verdict.verdict


def examples_of(rule: ast.Scoped) -> list[tuple[str, Expected]]:
    """Names with what is expected, the violating ones first."""
    kinds: list[tuple[Expected, tuple[str, ...]]] = [
        ("violation", rule.violates), ("pass", rule.passes), ("vacuous", rule.vacuous),
        ("inconclusive", rule.undecided),
    ]  # fmt: skip
    return [(name, expected) for expected, names in kinds for name in names]


def check_rule(rules: RuleSet, rule: ast.Scoped, library: Library) -> list[Checked]:
    """Judge every example of a rule or cost; one that cannot be judged is wrong, and stops no other."""
    checked = []
    for name, expected in examples_of(rule):
        try:
            verdict = library.judge(name, rules, rule)
            checked.append(Checked(rule.code, name, expected, verdict))
        except InputError as error:
            checked.append(Checked(rule.code, name, expected, problem=str(error)))
    return checked


def suite(rules: RuleSet, checked: Iterable[Checked], least: int) -> Suite:
    """The outcome of the examples of a rule set; each rule must have ``least`` each way."""
    counts = {
        code: (len(set(rule.violates)), len(set(rule.passes)))
        for code, rule in deciding(rules).items()
    }
    lacking = {code: count for code, count in counts.items() if min(count) < least}
    return Suite(tuple(checked), lacking, least)
