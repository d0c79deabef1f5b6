"""How a check is declared: once, above the function that carries it out.

Scoring, the audit, ``--explain``, the page of documentation and the tests read the declaration; there
are no other lists of codes.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, Literal, TypeVar

Severity = Literal["error", "warning", "note"]

SEVERITIES: tuple[Severity, ...] = ("error", "warning", "note")
"""The gravest first."""

Over = Literal["header", "columns", "episode", "scene", "campaign"]

Of = Literal["recording", "scene", "evaluation"]

KINDS: dict[str, tuple[Of, Over]] = {
    "AUD1": ("recording", "episode"),
    "AUD2": ("scene", "scene"),
    "AUD3": ("evaluation", "campaign"),
}
"""How codes begin → what such checks are about, and what their functions usually take."""

Run = Callable[[Any], Iterator[Any]]


@dataclass(frozen=True)
class Check:
    """One check.

    Attributes:
        code: ``AUD1xx`` of a recording, ``AUD2xx`` of a scene, ``AUD3xx`` of an evaluation.
        severity: of what it finds, unless a defect says otherwise.
        title: the defect in a few words, as a heading.
        why: what it does to verdicts, in a sentence or two.
        example: a recording that has it.
        issue: where it went wrong in public: ``lerobot#4465``; None if we know of none.
        over: what the function takes. ``header``: an ``Episode``, of which it reads header and time
            stamps alone; ``columns``: ``Columns``. Both yield contradictions, which scoring leaves
            unknown or refuses (``ContradictionError.hides``). The others yield defects for the audit.
            ``episode``: a ``Subject``; ``scene``: a ``Start``, of sound recordings; ``campaign``: a
            ``Campaign``, the summaries of all episodes.
        unless: codes of checks of the same episode that explain the defect better: nothing is
            reported about bodies of which one of them reported something, or about any if it
            reported something of the whole recording.
        cheap: worth doing with every scoring.
        run: the declared function.
        more: functions of a ``Subject`` that look for the same defect where columns do not show it.
    """

    code: str
    severity: Severity
    title: str
    why: str
    example: str
    issue: str | None
    over: Over
    unless: tuple[str, ...]
    cheap: bool
    run: Run
    more: list[Run] = field(default_factory=list)

    @property
    def of(self) -> Of:
        """What it is about."""
        return KINDS[self.code[:4]][0]

    @property
    def how(self) -> str:
        """How it is found: the docstrings of the functions, in one paragraph."""
        return " ".join(" ".join((run.__doc__ or "").split()) for run in (self.run, *self.more))


CHECKS: dict[str, Check] = {}
"""Every declared check by its code, sorted; complete once ``safestage_eval.audit.checks`` is imported."""

Declared = TypeVar("Declared", bound=Callable[..., Iterator[Any]])


def check(
    code: str,
    severity: Severity,
    *,
    title: str,
    why: str,
    example: str,
    issue: str | None = None,
    over: Over | None = None,
    unless: tuple[str, ...] = (),
    cheap: bool = False,
) -> Callable[[Declared], Declared]:
    """Declare a check by the generator below; arguments as in ``Check``.

    ``over``: by default as in ``KINDS``.

    Raises ValueError for a taken code, and one that does not begin as those of a kind do.
    """
    if code in CHECKS or not re.fullmatch(r"AUD[123]\d\d", code):
        raise ValueError(f"{code} is taken, or no code of a check")
    where = over or KINDS[code[:4]][1]

    def declare(run: Declared) -> Declared:
        CHECKS[code] = Check(code, severity, title, why, example, issue, where, unless, cheap, run)
        for name in sorted(CHECKS):  # independent of the order of imports
            CHECKS[name] = CHECKS.pop(name)
        return run

    return declare


def also(code: str) -> Callable[[Declared], Declared]:
    """Declare that the generator below, of a ``Subject``, looks for the defect of a declared check too."""

    def declare(run: Declared) -> Declared:
        CHECKS[code].more.append(run)
        return run

    return declare
