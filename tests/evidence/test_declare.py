"""A signal is declared once: above its function, and everything else reads the declaration."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from growing import growing
from scenes import Scene

import safestage_eval.signals
from safestage_eval.episode import Episode, Geom
from safestage_eval.evidence import declare
from safestage_eval.evidence.declare import RELATIONS, SIGNALS, Option, signal
from safestage_eval.evidence.facts import Request
from safestage_eval.evidence.intervals import Interval
from safestage_eval.monitor import Monitor
from safestage_eval.rules import RuleErrors, load_rules
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.load import RuleFile, merge
from safestage_eval.verdicts import judge
from safestage_eval.verdicts.ask import ask

FILES = Path(safestage_eval.signals.__file__).parent
RULE = """
[ruleset]
format = 1
name = "ceiling"
version = "1"
[signal.room_below_two]
base = "toy_headroom"
edge_drop = "2 m"
[[rule]]
code = "ETS901"
title = "stay below the ceiling"
roles = { a = "object" }
require = { "LEFT" = ">= 5 cm" }
"""


@pytest.fixture
def toy() -> Iterator[None]:
    """A signal that a test declares, as a new file in ``signals/`` would."""
    ceiling = Option("edge_drop", "length", "How high the ceiling is.", default=1.0)

    @signal(
        "toy_headroom", "length", args=("a",), needs=("poses",), options=(ceiling,), reads="com",
    )  # fmt: skip
    def toy_headroom(request: Request) -> Interval:
        """Distance of the centre of mass from a ceiling."""
        height = float(dict(request.options).get("edge_drop", 1.0))  # type: ignore[arg-type]
        return request.exact(height - request.facts.com_position(request.bodies[0])[:, 2])

    yield
    del SIGNALS["toy_headroom"]


def rising() -> Episode:
    """A ball that rises by 1 m in 1 s."""
    path = np.column_stack([np.zeros(120), np.zeros(120), np.linspace(0, 1, 120)])
    scene = Scene(120).body("ball", Geom(kind="sphere", size=(0.05,)), path)
    return scene.fixed("table").episode(termination="horizon", roles={"a": ("ball",)})


def rules(call: str) -> ast.RuleSet:
    text = RULE.replace("LEFT", call)
    if "below_two" not in call:  # a definition that nothing reads is a mistake
        text = text.replace(
            '[signal.room_below_two]\nbase = "toy_headroom"\nedge_drop = "2 m"\n', ""
        )
    return merge([RuleFile("ceiling.toml", text, tomllib.loads(text), asked=True)])


@pytest.mark.usefixtures("toy")
def test_a_declared_signal_is_measured() -> None:
    values = ask(rising(), "toy_headroom(ball)")
    np.testing.assert_allclose(values.lower, np.linspace(1, 0, 120), atol=1e-6)


@pytest.mark.usefixtures("toy")
@pytest.mark.parametrize(
    ("call", "verdict"), [("toy_headroom(a)", "violation"), ("room_below_two(a)", "pass")]
)
def test_it_stands_in_rules_and_variants(call: str, verdict: str) -> None:
    (found,) = judge(rising(), rules(call), trace_hash="").verdicts
    assert found.verdict == verdict


@pytest.mark.usefixtures("toy")
@pytest.mark.parametrize(
    ("call", "limit", "code"),
    [("toy_headroom(a, a)", "5 cm", "R402"), ("toy_headroom(a)", "5 N", "R407")],
)
def test_its_unit_and_arguments_are_checked(
    call: str, limit: str, code: str, tmp_path: Path
) -> None:
    file = tmp_path / "ceiling.toml"
    file.write_text(RULE.replace("LEFT", call).replace("5 cm", limit), "utf-8")
    with pytest.raises(RuleErrors) as problems:
        load_rules([str(file)])
    assert code in {problem.code for problem in problems.value.diagnostics}


@pytest.mark.usefixtures("toy")
def test_the_monitor_watches_it() -> None:
    episode, ceiling = rising(), rules("toy_headroom(a)")
    so_far = growing(episode)
    monitor = Monitor(episode.header, ceiling)
    first = None
    for frames in range(30, 121, 30):
        so_far.frames = frames
        if monitor.update(so_far):
            first = first or frames
    offline = judge(episode, ceiling, trace_hash="").verdicts[0].time
    assert offline == pytest.approx(0.95, abs=0.02)
    assert first == 120  # the first look after that
    assert monitor.violations["ETS901"].time == pytest.approx(offline)


def test_every_file_of_the_room_declares_signals() -> None:
    declaring = {Path(one.measure.__code__.co_filename) for one in SIGNALS.values()}
    assert declaring == set(FILES.glob("*.py")) - {FILES / "__init__.py"}


@pytest.mark.parametrize("name", [*SIGNALS, *RELATIONS])
def test_a_declaration_is_complete(name: str) -> None:
    one = SIGNALS.get(name) or RELATIONS[name]
    assert one.meaning.endswith(".")
    assert one.needs
    if isinstance(one, declare.Signal):
        assert not (one.symmetric and len(one.args) != 2)
        assert not (one.costly and not one.support)
        assert not (one.from_start and not one.since)
