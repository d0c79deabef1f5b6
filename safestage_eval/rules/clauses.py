"""The obligations that a ``[[rule]]`` may have: each declared once, for all that reads rules."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

ClauseKind = Literal["require", "forbid", "reach"]


@dataclass(frozen=True)
class ClauseSpec:
    """One kind of obligation, as far as the text of a rule goes.

    Attributes:
        kind: its key in a rule, and the field of ``syntax.Rule`` that holds it.
        value: what the key holds, as in ``keys.Key``; of ``alternatives``, any one counts.
        meaning: one sentence, shown by editors.
        heading: what reports write before it.
        wanted: it must hold; if false, the rule is broken where it holds.
        once: it is enough that it holds at one moment, so that only the end of a scope breaks it.
        lasts: the rule's ``for`` says how long it must hold to count.
    """

    kind: ClauseKind
    value: Literal["condition", "alternative", "alternatives"]
    meaning: str
    heading: str
    wanted: bool
    once: bool
    lasts: bool

    @cached_property
    def breaks(self) -> bool | None:
        """Broken at a frame where its condition holds, or (False) does not; None: at no one frame."""
        return None if self.once else not self.wanted

    def entries(self, value: Any) -> tuple[Any, ...]:
        """The entries of what a rule holds under the key: atoms, or alternatives; none if None."""
        if value is None:
            return ()
        if self.value == "alternative":
            return (value,)
        items: tuple[Any, ...] = value.atoms if self.value == "condition" else value
        return items


CLAUSES: dict[ClauseKind, ClauseSpec] = {
    spec.kind: spec
    for spec in (
        ClauseSpec(
            "require",
            "condition",
            "Must hold in every frame that is judged.",
            "always",
            wanted=True,
            once=False,
            lasts=False,
        ),
        ClauseSpec(
            "forbid",
            "alternatives",
            "Must hold in no frame; a list forbids each of its items.",
            "never",
            wanted=False,
            once=False,
            lasts=True,
        ),
        ClauseSpec(
            "reach",
            "alternative",
            "Must hold in some frame.",
            "at some time",
            wanted=True,
            once=True,
            lasts=True,
        ),
    )
}
"""Kind → its declaration, in the order in which rules are read out."""
