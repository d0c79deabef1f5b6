"""Goldens in pytest: a lab's own traces keep their verdicts, or its tests say what changed.

The fixture ``safestage_golden`` is there as soon as SafeStage is installed (docs/ci.md)::

    def test_our_traces(safestage_golden):
        safestage_golden("traces/", "expected.json", rules="fsh", edge="3 cm")

``pytest --safestage-update`` rewrites the golden files instead of comparing.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

UPDATE = "--safestage-update"

Check = Callable[..., None]


def pytest_addoption(parser: pytest.Parser) -> None:
    """``--safestage-update``."""
    group = parser.getgroup("safestage")
    group.addoption(
        UPDATE, action="store_true", help="Rewrite the golden files of safestage_golden."
    )


@pytest.fixture
def safestage_golden(request: pytest.FixtureRequest) -> Check:
    """A function that judges traces and fails the test where the verdicts are not those expected.

    Its arguments:
        traces: files or folders, relative to the folder of the test.
        golden: the file with the expected verdicts, as ``safestage score --golden`` writes it.
        rules: rule files, folders or built-in names; all built-in ones if left out.
        bind: a bind file for traces whose headers lack something.
        jobs: worker processes; 1 if left out.
        settings: parameter values, ``edge="3 cm"``.
    """
    here = request.path.parent
    update = bool(request.config.getoption(UPDATE))

    def check(
        traces: str | Path | Sequence[str | Path],
        golden: str | Path,
        *,
        rules: str | Path | Sequence[str | Path] = (),
        bind: str | Path | None = None,
        jobs: int | None = 1,
        **settings: str,
    ) -> None:
        __tracebackhide__ = True
        from safestage_eval.errors import InputError

        try:
            said = _compared(
                [here / path for path in _several(traces)],
                here / golden,
                [_rules(here, rule) for rule in _several(rules)],
                None if bind is None else here / bind,
                jobs,
                settings,
                update=update,
            )
        except InputError as error:
            said = [str(error)]
        if said:
            pytest.fail("\n".join(said), pytrace=False)

    return check


def _compared(
    traces: Sequence[Path],
    golden: Path,
    rules: Sequence[str | Path],
    bind: Path | None,
    jobs: int | None,
    settings: dict[str, str],
    *,
    update: bool,
) -> list[str]:
    from safestage_eval.report.golden import changes, write_golden
    from safestage_eval.run.score_traces import score_paths

    scores = score_paths(traces, rules, overrides=settings, bind=bind, jobs=jobs)
    if update:
        write_golden(scores, golden)
        return []
    problems = [f"cannot be judged: {problem.message}" for problem in scores.problems]
    found = changes(scores, golden, f"pytest {UPDATE}")
    if not (problems or found):
        return []
    number = len(problems) + len(found)
    head = f"{golden}: {number} difference{'s' * (number > 1)}; if they are meant, pytest {UPDATE}"
    return [head, *(f"  {line}" for line in (*problems, *found))]


def _several(value: str | Path | Sequence[str | Path]) -> list[str | Path]:
    return [value] if isinstance(value, str | Path) else list(value)


def _rules(here: Path, rule: str | Path) -> str | Path:
    """A file or folder beside the test, or else a built-in name."""
    return here / rule if (here / rule).exists() else rule
