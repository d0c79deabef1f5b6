"""Choose checks by their codes."""

from __future__ import annotations

from collections.abc import Iterable

from safestage_eval.doubts.check_registry import CHECKS, Check
from safestage_eval.errors import InputError, did_you_mean


def choose(select: Iterable[str] = (), ignore: Iterable[str] = ()) -> tuple[Check, ...]:
    """The checks that are meant, by code: a code, or how several begin (``AUD1``).

    Args:
        select: those alone; empty for all.
        ignore: without these.

    Raises:
        InputError: a code that no check has.
    """
    from . import checks as _all  # noqa: F401 — declares those that are not of columns

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
