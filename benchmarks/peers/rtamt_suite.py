"""RTAMT's own API tests, said in our rule language and compared value by value.

    python benchmarks/peers/rtamt_suite.py CHECKOUT [--page docs/rtamt.md]

CHECKOUT is a clone of github.com/nickovic/rtamt; its tests are run with its own code (which needs the
package antlr4-python3-runtime), and must pass. What they feed in and what RTAMT answers is recorded; each formula is then
translated into signals, states and rules, and evaluated on a trace whose recorded scalars are the test's
variables, 10 ms apart. (This file cannot be called rtamt.py: it would hide the package.)
"""

from __future__ import annotations

import argparse
import importlib
import itertools
import math
import subprocess
import sys
import unittest
import warnings
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

sys.path.append(str(Path(__file__).resolve().parent))

from rtamt_formulas import CannotSayError, Formula, values

SUITES = (
    "test_stl_discrete_time_offline_specification",
    "test_stl_discrete_time_online_specification",
    "test_ltl_discrete_time_online_specification",
    "test_stl_reset",
    "test_spec",
    "test_iastl_discrete_time_offline_specification",
    "test_iastl_discrete_time_online_specification",
    "test_stl_pastification",
    "test_stl_sampling_time_units",
    "test_sampling_frequency",
    "test_stl_interval_style",
    "test_browsing_monitoring_results",
    "test_object_vars",
    "test_stl_dense_time_offline_specification",
    "test_stl_dense_time_online_specification",
    "test_iastl_dense_time_online_specification",
)
KINDS = (
    "StlDiscreteTimeSpecification", "StlDenseTimeSpecification", "LtlDiscreteTimeSpecification",
    "IAStlDiscreteTimeSpecification", "IAStlDenseTimeSpecification",
    "StlDiscreteTimeOfflineSpecification", "StlDiscreteTimeOnlineSpecification",
    "StlDenseTimeOfflineSpecification", "StlDenseTimeOnlineSpecification",
    "LTLDiscreteTimeSpecification",
)  # fmt: skip
SPECIFICATIONS = ("rtamt.spec.stl.discrete_time.specification",)
"""Modules from which tests take specifications by name."""


# ---- what the tests feed in, and what RTAMT answers


@dataclass
class Run:
    """One specification from one reset to the next."""

    kind: str
    formula: str = ""
    constants: dict[str, float] = field(default_factory=dict)
    samples: dict[str, list[Any]] = field(default_factory=dict)
    answers: list[Any] = field(default_factory=list)
    why_not: str = ""


class Recorder:
    """Stands for a specification of RTAMT, and notes down what is asked of it."""

    def __init__(self, kind: str, real: Any, runs: list[Run]) -> None:
        vars(self).update(_real=real, _runs=runs, _run=Run(kind), _kind=kind)
        runs.append(self._run)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._real, name)

    def __setattr__(self, name: str, value: Any) -> None:
        if name == "spec":
            self._run.formula = value
        if name in ("unit", "semantics") or name.startswith("sampling"):
            self._run.why_not = f"sets {name}"
        setattr(self._real, name, value)

    def declare_const(self, name: str, kind: str, value: Any) -> None:
        """A constant."""
        self._run.constants[name] = float(value)
        self._real.declare_const(name, kind, value)

    def pastify(self) -> None:
        """Answers come later."""
        self._run.why_not = (
            "is answered later: pastified, so that a window is over when it is answered"
        )
        self._real.pastify()

    def set_sampling_period(self, *args: Any) -> None:
        """Only RTAMT's."""
        self._run.why_not = "is about the tool: sampling periods and units of time"
        self._real.set_sampling_period(*args)

    def set_var_io_type(self, *args: Any) -> None:
        """Only RTAMT's."""
        self._run.why_not = "is about inputs and outputs (IA-STL), of which rules know nothing"
        self._real.set_var_io_type(*args)

    def reset(self) -> None:
        """A new run."""
        old = self._run
        vars(self)["_run"] = Run(self._kind, old.formula, old.constants, why_not=old.why_not)
        self._runs.append(self._run)
        self._real.reset()

    def evaluate(self, *data: Any) -> Any:
        """All samples at once."""
        found = self._real.evaluate(*data)
        if "Dense" in self._kind or not isinstance(data[0], dict):
            self._run.why_not = DENSE
        else:
            self._run.samples = {k: v for k, v in data[0].items() if k != "time"}
            self._run.answers = [value for _, value in found]
        return found

    def update(self, *data: Any) -> Any:
        """One sample more."""
        found = self._real.update(*data)
        if "Dense" in self._kind:
            self._run.why_not = DENSE
            return found
        for name, value in data[1]:
            self._run.samples.setdefault(name, []).append(value)
        self._run.answers.append(found)
        return found


DENSE = (
    "is in dense time: robustness of a function of continuous time, where ours is that of samples"
)


def recorded(checkout: Path) -> Iterator[tuple[str, str, list[Run], str]]:
    """Suite, test, what it asked, and why it did not pass (empty: it did)."""
    sys.path.insert(0, str(checkout))
    modules = [importlib.import_module(name) for name in ("rtamt", *SPECIFICATIONS)]
    runs: list[Run] = []
    for module, kind in itertools.product(modules, KINDS):
        if hasattr(module, kind):
            setattr(module, kind, _standing_for(kind, getattr(module, kind), runs))
    for suite in SUITES:
        module = importlib.import_module(f"tests.python.api.{suite}")
        for case in unittest.defaultTestLoader.loadTestsFromModule(module):
            for test in case:
                runs.clear()
                result = unittest.TestResult()
                test.run(result)
                failed = [text.splitlines()[-1] for _, text in result.errors + result.failures]
                name = test.id().rpartition(".")[2]
                yield suite, name, [r for r in runs if r.formula], next(iter(failed), "")


def _standing_for(kind: str, real: Any, runs: list[Run]) -> Any:
    return lambda *args, **more: Recorder(kind, real(*args, **more), runs)


def compared(run: Run) -> tuple[int, list[str]]:
    """How many values were compared, and those that differ. Raises CannotSayError."""
    if run.why_not:
        raise CannotSayError(run.why_not)
    formula = Formula(run.formula, run.constants)
    if not run.answers:
        raise CannotSayError("expects RTAMT to refuse the formula, or to evaluate nothing")
    if not run.samples or formula.variables - {"anything"} - set(run.samples):
        raise CannotSayError("evaluates objects, not numbers")
    try:
        ours = values(formula, run.samples)
    except (TypeError, ValueError) as error:
        raise CannotSayError(f"evaluates objects, not numbers ({error})") from error
    wrong = [
        f"sample {k}: RTAMT {theirs:g}, here {mine:g}"
        for k, (theirs, mine) in enumerate(zip(run.answers, ours, strict=True))
        if not _equal(float(theirs), mine)
    ]
    return len(ours), wrong


def _equal(theirs: float, mine: float) -> bool:
    return theirs == mine or math.isclose(theirs, mine, rel_tol=1e-9, abs_tol=1e-9)


@dataclass
class Outcome:
    """Outcome of one test."""

    suite: str
    test: str
    formula: str
    state: str
    why: str
    values: int = 0


def outcome(suite: str, test: str, runs: list[Run], failed: str) -> Outcome:
    """Compare all that a test asked."""
    formula = runs[0].formula if runs else ""
    if failed:
        return Outcome(
            suite, test, formula, "not run", f"does not pass with RTAMT itself: {failed}"
        )
    if not runs:
        return Outcome(
            suite, test, "", "not said", "is about RTAMT's parser and rewriting, no values"
        )
    total = 0
    for run in runs:
        try:
            count, wrong = compared(run)
        except CannotSayError as error:
            if total and not run.answers:  # after a reset nothing more was asked
                continue
            return Outcome(suite, test, formula, "not said", str(error))
        total += count
        if wrong:
            return Outcome(suite, test, formula, "differs", wrong[0], total)
    return Outcome(suite, test, formula, "agrees", "", total)


def page(found: list[Outcome], commit: str) -> str:
    """The page of the documentation."""
    by_suite = {suite: [one for one in found if one.suite == suite] for suite in SUITES}
    said = [one for one in found if one.state in ("agrees", "differs")]
    agree = [one for one in said if one.state == "agrees"]
    lines = [
        "# RTAMT's tests in our language", "",
        "Written by `benchmarks/peers/rtamt_suite.py`. RTAMT monitors signal temporal logic (github.com/",
        f"nickovic/rtamt at {commit}). Its API tests are run, and what they ask is",
        "translated into signals, states and rules and evaluated on a trace whose recorded scalars are the",
        "tests' variables. Formulas about the past become states (`once`, `always`, `since`), those about the",
        "future a rule that is judged from each sample on. Every value is compared, not only its sign.", "",
        f"Of {len(found)} tests {len(said)} can be said, and {len(agree)} agree, in"
        f" {sum(one.values for one in agree)} values.", "",
        "| suite | tests | said | agree |", "|---|---|---|---|",
    ]  # fmt: skip
    for suite, ones in by_suite.items():
        words = [one for one in ones if one.state in ("agrees", "differs")]
        same = sum(one.state == "agrees" for one in ones)
        lines.append(f"| {suite} | {len(ones)} | {len(words)} | {same} |")
    lines += ["", "RTAMT's `iff` and `xor` are −\\|p − q\\| and \\|p − q\\|: an `iff` of two formulas that hold by 1",
              "and by 2 has the robustness −1. They are said as `==` and `!==` here. Our own `iff` is positive where",
              "both hold, or neither does ([rules.md](rules.md#states-as-they-were)).", "",
              "## What differs", ""]  # fmt: skip
    differing = [one for one in said if one.state == "differs"]
    lines += [f"- {one.suite}, {one.test}, `{one.formula}`: {one.why}" for one in differing]
    lines += ["Nothing."] if not differing else []
    lines += [
        "",
        "## What is not said",
        "",
        "| the test … | tests | for instance |",
        "|---|---|---|",
    ]
    left = [one for one in found if one.state in ("not said", "not run")]
    for why, count in Counter(one.why for one in left).most_common():
        one = next(item for item in left if item.why == why)
        shown = f"`{one.formula}` ({one.test})" if one.formula else one.test
        lines.append(f"| {_cell(why)} | {count} | {_cell(shown)} |")
    return "\n".join(lines) + "\n"


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def main() -> None:
    """See the module."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("checkout", type=Path, help="clone of github.com/nickovic/rtamt")
    options.add_argument("--page", type=Path, help="page to write")
    given = options.parse_args()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = [outcome(*one) for one in recorded(given.checkout.resolve())]
    for one in found:
        if one.state == "differs" or not given.page:
            print(f"{one.state:9} {one.suite}.{one.test}: {one.formula or '-'} {one.why}")
    print(Counter(one.state for one in found))
    if given.page:
        git = ["git", "-C", str(given.checkout), "rev-parse", "--short", "HEAD"]
        commit = subprocess.run(git, capture_output=True, text=True, check=True).stdout.strip()
        given.page.write_text(page(found, commit), "utf-8")


if __name__ == "__main__":
    main()
