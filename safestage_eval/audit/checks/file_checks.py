"""Checks of the format: what ``safestage audit --files`` lists in full."""

from __future__ import annotations

from collections.abc import Iterator

from safestage_eval.audit.finding import Defect
from safestage_eval.audit.subject import Subject
from safestage_eval.doubts.check_registry import check


@check(
    "AUD100",
    "error",
    title="the file breaks the format",
    why="Nothing is judged: columns are missing, have the wrong length, or time goes back. "
    "Its motion and contacts are not looked at either.",
    example="a column of poses with fewer rows than time stamps",
    issue="huggingface/lerobot#933",
)
def broken_format(subject: Subject) -> Iterator[Defect]:
    """Checks lengths, increasing time, unit quaternions and names in contacts."""
    errors = subject.broken
    if not errors:
        return
    first, more = errors[0], len(errors) - 1
    yield Defect(
        first.what.rstrip(".")
        + (f". Expected: {first.allowed}." if first.allowed else ".")
        + (f" And {more} more." if more else ""),
        first.fix or "safestage audit --files lists everything that is wrong with the file",
    )
