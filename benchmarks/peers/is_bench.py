"""IS-Bench's conditions and its evaluator, on the scenes that are drawn from them.

Every condition of every task is compiled by its own language package and looked at by its own
evaluator, over what the scene shows; our rule judges the scene.

    python benchmarks/peers/is_bench.py CHECKOUT      prints how many conditions each rule says
"""

from __future__ import annotations

import importlib
import json
import re
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from is_bench_scenes import Condition, conditions, truths, verdict
from peer_code import code_of, functions
from tally import Tally

from safestage_eval.episode import Episode

EVALUATOR = "og_ego_prim/benchmark/evaluator/evaluator.py"
METHODS = {
    "process": "Evaluator.evaluate_process_safety_goal_condition",
    "termination": "Evaluator.evaluate_termination_safety_goal_condition",
}
NAME = re.compile(r"([a-z_]+)\.n\.\d+_\d+")
Raw = dict[str, Any]
FUTURE = {
    "future.utils": {"with_metaclass": lambda meta, *bases: meta("Base", bases or (object,), {})}
}
"""Names that the peer imports from the package future."""


def raw_conditions(checkout: Path) -> Iterator[tuple[str, Raw, list[str]]]:
    """Kind, condition and objects of the task, of every task of a checkout."""
    for path in sorted((checkout / "data" / "tasks").glob("*.json")):
        task = json.loads(path.read_text("utf-8"))
        for kind in METHODS:
            for raw in task["evaluation_goal_conditions"][f"{kind}_safety_goal_condition"]:
                yield kind, raw, task["planning_context"]["object_list"]


def parts(tree: Any, wanted: bool = True) -> list[tuple[str, tuple[str, ...], bool]]:
    """Predicates of a condition in the order in which they stand: name, bodies, whether wanted."""
    head, *rest = tree
    if head in (":goal", "and"):
        return [part for branch in rest for part in parts(branch, wanted)]
    if head == "not":
        return parts(rest[0], not wanted)
    if head == "forall":
        return parts(rest[1], wanted)
    return [(head, tuple(body.strip("?") for body in rest), wanted)]


def said(raw: Raw, tree: Any) -> tuple[str, str]:
    """Action and condition as the table writes them."""
    found = parts(tree)
    action = (raw["action"] or "end").strip()
    verb, _, inner = action.partition("(")
    args = [a.strip() for a in inner.rstrip(") ").split(",") if a.strip()]
    several: dict[str, list[str]] = {}
    for body in [b for _, bodies, _ in found for b in bodies]:
        if NAME.fullmatch(body) and body not in several.setdefault(body.split(".")[0], []):
            several[body.split(".")[0]].append(body)
    for body in args:
        if body.split(".")[0] in several and body not in several[body.split(".")[0]]:
            several[body.split(".")[0]].append(body)

    def short(body: str) -> str:
        kind = body.split(".", maxsplit=1)[0]
        alike = several.get(kind, [])
        return f"{kind}_{alike.index(body) + 1}" if len(alike) > 1 and body in alike else kind

    listed = [" ".join(("not " * (not w) + p, *map(short, b))) for p, b, w in found]
    return " ".join([verb, *map(short, args)]), " and ".join(listed)


@contextmanager
def comparing(checkout: Path) -> Iterator[Callable[[Episode | None, Tally], None]]:
    """All conditions in all their cases; traces are not looked at."""
    with code_of(checkout / "bddl", absent=["future"], given=FUTURE):
        language = importlib.import_module("bddl.condition_evaluation")
        parsing, atoms = (
            importlib.import_module("bddl.parsing"),
            importlib.import_module("bddl.logic_base"),
        )
        methods = functions(checkout / EVALUATOR, METHODS.values())
        table = {_key(condition): condition for condition in conditions()}

        def compile_condition(raw: Raw, objects: list[str], shown: dict[Any, bool]) -> Any:
            tokens = parsing.scan_tokens(string=raw["safety_bddl"])
            goals: list[Any] = []
            parsing.package_predicates(tokens[1], goals, "", "goals")
            scope = {name: SimpleNamespace(name=name) for name in objects}
            kinds: dict[str, list[str]] = {}
            for name in objects:
                kinds.setdefault(name.rpartition("_")[0], []).append(name)

            class Seen:
                def get_predicate_class(self, name: str) -> Any:
                    one = {"_evaluate": lambda _, a: shown[name, (a.name,)], "_sample": None}
                    two = {
                        "_evaluate": lambda _, a, b: shown[name, (a.name, b.name)],
                        "_sample": None,
                    }
                    unary = name in ("open", "frozen", "toggled_on")
                    base = atoms.UnaryAtomicFormula if unary else atoms.BinaryAtomicFormula
                    return type(name, (base,), {**(one if unary else two), "STATE_NAME": name})

            heads = language.compile_state(goals, Seen(), scope=scope, object_map=kinds)
            return lambda: all(head.evaluate() for head in heads)

        def compare(episode: Episode | None, tally: Tally) -> None:
            if episode is not None:
                return
            judged: dict[tuple[str, str], str] = {}
            for kind, raw, listed in raw_conditions(checkout):
                tree = parsing.scan_tokens(string=raw["safety_bddl"])
                condition = table[said(raw, tree)]
                named = [b for _, bodies, _ in parts(tree) for b in bodies if NAME.fullmatch(b)]
                objects = [*listed, *dict.fromkeys(b for b in named if b not in listed)]
                waters = [b for _, bodies, _ in parts(tree) for b in bodies[1:] if b not in objects]
                objects += [b for b in waters if not any(o.startswith(f"{b}_") for o in objects)]
                for case in condition.cases:
                    shown = _shown(parts(tree), truths(condition, case), objects)
                    holds = compile_condition(raw, objects, shown)
                    theirs = _evaluated(methods[METHODS[kind]], kind, raw, holds, case)
                    key = (str(condition), case)
                    if key not in judged:
                        judged[key] = verdict(condition, case)
                    one = tally.count(condition.rule, METHODS[kind], "cases")
                    one.run += 1
                    ours = {"pass": True, "violation": False, "vacuous": None}.get(
                        judged[key], judged[key]
                    )
                    if ours is theirs:
                        one.agreed += 1
                    else:
                        one.differences[
                            f"{case.split()[0]}: {judged[key]} here, {theirs} there"
                        ] += 1

        yield compare


def _key(condition: Condition) -> tuple[str, str]:
    return " ".join(condition.action), condition.said


def _shown(
    found: list[tuple[str, tuple[str, ...], bool]], truth: list[bool], objects: list[str]
) -> dict[Any, bool]:
    """Predicate of bodies → whether it holds; one of a kind of bodies stands for all of them."""
    shown = {}
    for (predicate, bodies, _), true in zip(found, truth, strict=True):
        every = [
            [o for o in objects if o == b or (b not in objects and o.startswith(f"{b}_"))]
            for b in bodies
        ]
        for first in every[0]:
            for rest in every[1] if len(every) > 1 else [None]:
                shown[predicate, (first,) if rest is None else (first, rest)] = true
    return shown


def _evaluated(
    method: Any, kind: str, raw: Raw, holds: Callable[[], bool], case: str
) -> bool | None:
    """Conditions that the evaluator tracks: met or not, None where it did not look."""
    tracked: list[bool | None] = []
    tell = lambda **told: tracked.append(told["eval"])  # noqa: E731
    entry = {
        **raw, "bddl": raw["safety_bddl"],
        "bddl_evaluator": SimpleNamespace(step=lambda *_: (None, holds())),
    }  # fmt: skip
    happened = case != "idle"
    tracker = SimpleNamespace(
        track_process_safety_goal_condition=tell, track_termination_safety_goal_condition=tell,
        plans=[{"plan": {"action": raw["action"] or ""}}] if happened else [],
        goal_condition={"execution_goal_condition": {"eval": happened}},
    )  # fmt: skip
    task = SimpleNamespace(env=SimpleNamespace(task=None), tracker=tracker)
    if kind == "process":
        action = raw["action"].strip().lower().replace(" ", "")
        task.process_safety_goal_condition = {(raw["type"].strip().lower(), action): entry}
        if happened:
            method(task, {"action": raw["action"]}, raw["type"], verbose=False)
    else:
        task.termination_safety_goal_condition = [entry]
        method(task, verbose=False)
    return tracked[0] if tracked else None


def counts(checkout: Path) -> Counter[str]:
    """Rule → how many conditions of a checkout it says. Raises KeyError for one that none says."""
    table = {_key(condition): condition.rule for condition in conditions()}
    with code_of(checkout / "bddl", absent=["future"], given=FUTURE):
        scan = importlib.import_module("bddl.parsing").scan_tokens
        return Counter(
            table[said(raw, scan(string=raw["safety_bddl"]))]
            for _, raw, _ in raw_conditions(checkout)
        )


if __name__ == "__main__":
    found = counts(Path(sys.argv[1]))
    for rule, count in sorted(found.items()):
        print(rule, count)
    print("conditions:", found.total())
