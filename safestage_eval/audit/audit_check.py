"""How a check is declared: once, above the function that carries it out.

The audit, ``--explain``, the page of documentation and the tests read the declaration; there are no
other lists of codes.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Literal, TypeVar

from safestage_eval.errors import InputError, did_you_mean

from .finding import Defect, Severity

Of = Literal["recording", "scene", "evaluation"]

CODES: dict[Of, str] = {"recording": "AUD1", "scene": "AUD2", "evaluation": "AUD3"}
"""Subject of a check → prefix of its code."""


@dataclass(frozen=True)
class Check:
    """One check.

    Attributes:
        code: ``AUD1xx`` of a recording, ``AUD2xx`` of a scene, ``AUD3xx`` of an evaluation.
        severity: of what it finds, unless a defect says otherwise.
        of: what it is about.
        title: the defect in a few words, as a heading.
        why: what it does to verdicts, in a sentence or two.
        example: a recording that has it.
        issue: where it went wrong in public: ``lerobot#4465``; None if we know of none.
        over: ``episode``: the function takes a ``Subject``, in a worker process; ``campaign``: it
            takes a ``Campaign``, the summaries of all episodes.
        unless: codes of checks of the same episode that explain the defect better: nothing is
            reported about bodies of which one of them reported something, or about any if it
            reported something of the whole recording.
        cheap: worth doing with every scoring.
        run: the declared function.
    """

    code: str
    severity: Severity
    of: Of
    title: str
    why: str
    example: str
    issue: str | None
    over: Literal["episode", "campaign"]
    unless: tuple[str, ...]
    cheap: bool
    run: Callable[[Any], Iterator[Defect]]

    @property
    def how(self) -> str:
        """How it is found: the docstring of the function, in one paragraph."""
        return " ".join((self.run.__doc__ or "").split())


CHECKS: dict[str, Check] = {}
"""Every declared check by its code, sorted; complete once ``safestage_eval.audit.checks`` is imported."""

Run = TypeVar("Run", bound=Callable[..., Iterator[Defect]])


def check(
    code: str,
    severity: Severity,
    *,
    of: Of,
    title: str,
    why: str,
    example: str,
    issue: str | None = None,
    over: Literal["episode", "campaign"] | None = None,
    unless: tuple[str, ...] = (),
    cheap: bool = False,
) -> Callable[[Run], Run]:
    """Declare a check by the generator below; arguments as in ``Check``.

    ``over``: by default ``campaign`` of an evaluation, and ``episode`` of anything else.

    Raises ValueError for a taken code, and one that does not begin as its kind does.
    """
    if code in CHECKS or not re.fullmatch(CODES[of] + r"\d\d", code):
        raise ValueError(f"{code} is taken, or no code of a check of a {of}")
    where = over or ("campaign" if of == "evaluation" else "episode")

    def declare(run: Run) -> Run:
        CHECKS[code] = Check(
            code, severity, of, title, why, example, issue, where, unless, cheap, run
        )
        for name in sorted(CHECKS):  # independent of the order of imports
            CHECKS[name] = CHECKS.pop(name)
        return run

    return declare


def choose(select: Iterable[str] = (), ignore: Iterable[str] = ()) -> tuple[Check, ...]:
    """The checks that are meant, by code: a code, or how several begin (``AUD1``).

    Args:
        select: those alone; empty for all.
        ignore: without these.

    Raises:
        InputError: a code that no check has.
    """
    from . import checks as _all  # noqa: F401 — declares them

    def named(option: str, codes: Iterable[str]) -> set[str]:
        chosen_codes = set[str]()
        for code in codes:
            mine = {known for known in CHECKS if known.startswith(code.upper())}
            if not mine or not code:
                raise InputError(
                    f"{option} {code}", "no check has a code that begins so.", ", ".join(CHECKS),
                    did_you_mean(code.upper(), CHECKS, 0.0),
                )  # fmt: skip
            chosen_codes |= mine
        return chosen_codes

    chosen = named("--select", select) or {*CHECKS}
    chosen -= named("--ignore", ignore)
    return tuple(one for code, one in CHECKS.items() if code in chosen)
