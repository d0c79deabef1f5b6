"""The interface of every kind of obligation that a rule may have."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import ClassVar, NamedTuple

import numpy as np

from safestage_eval.episode import Window
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.clauses import CLAUSES, ClauseKind
from safestage_eval.states.band import Band, Bool
from safestage_eval.states.persistence import held_from
from safestage_eval.states.scope import Scope, mask_of
from safestage_eval.verdicts import event_order
from safestage_eval.verdicts.evaluate import Evaluator
from safestage_eval.verdicts.instance import Instance
from safestage_eval.verdicts.look_ahead import Foresight, Look
from safestage_eval.verdicts.search import Search
from safestage_eval.verdicts.values import Env
from safestage_eval.verdicts.witness import Witness


class Margin(NamedTuple):
    """Bounds of an obligation's margin in a scope; it is broken where ``upper`` is negative.

    Attributes:
        lower, upper: normalised.
        frame: that decides, counted from the scope's start.
    """

    lower: float
    upper: float
    frame: int


class Obligation(ABC):
    """One kind of obligation: its margin, what breaks it, its witness, its words, its foresight.

    Attributes:
        kind: as in ``rules.clauses``, which says what its text may be.
        wanted: it is met where its condition holds, not broken there.
        kept: the sentence of a pass that no single measurement decides; ``{begin}`` and ``{end}``
            are the times that were judged, ``{what}`` the obligation in words.
    """

    kind: ClassVar[ClauseKind]
    wanted: ClassVar[bool]
    kept: ClassVar[str]

    def __init_subclass__(cls) -> None:
        cls.wanted = CLAUSES[cls.kind].wanted

    # ---- margin

    def margin(
        self, evaluator: Evaluator, rule: ast.Rule, what: ast.Alternative, env: Env, scope: Scope
    ) -> Margin:
        """The margin of ``what`` in a scope, for the bodies of ``env``."""
        lasting = evaluator.window(rule.for_).within(scope.first, scope.stop)
        known = event_order.begun_between(what, scope, evaluator.clock.coarse)
        return self.margin_of(self.band(evaluator, what, env, scope), known.sure, lasting)

    def band(self, evaluator: Evaluator, what: ast.Alternative, env: Env, scope: Scope) -> Band:
        """(N,) margins of the condition in the N frames of a scope."""
        wanted = mask_of([scope], evaluator.frames) if evaluator.asks_costly(what) else None
        band = evaluator.obliged(self.kind, evaluator.alternative, what, env, wanted)
        return band.at(scope.first, scope.stop)

    @abstractmethod
    def margin_of(self, band: Band, sure: Bool | None, lasting: Window) -> Margin:
        """The margin, from those of the condition in the frames of a scope.

        Args:
            band: (N,).
            sure: (N,) the frames that are certainly judged, None for all: only they can break it,
                but all must be known to meet it.
            lasting: what ``for`` comes to in these frames.
        """

    def cut(self, margin: Margin) -> Margin:
        """The margin where the recording ends before the scope does."""
        return margin._replace(lower=-np.inf)

    @abstractmethod
    def broken(self, band: Band, sure: Bool, lasting: Window) -> Bool:
        """(N,) the frames of a scope that certainly break it; arguments as in ``margin_of``."""

    # ---- witness

    def first_witness(
        self,
        evaluator: Evaluator,  # noqa: ARG002
        rule: ast.Rule,  # noqa: ARG002
        instance: Instance,  # noqa: ARG002
        *,
        violated: bool,  # noqa: ARG002
    ) -> Witness | None:
        """A witness that takes precedence over the decisive measurement, if there is one."""
        return None

    def witness(
        self,
        evaluator: Evaluator,
        what: ast.Alternative,
        instance: Instance,
        frame: int,
        *,
        violated: bool,
    ) -> Witness:
        """The measurement behind the margin of ``what`` at a frame."""
        search = Search(evaluator, violated == self.wanted, 1 if self.wanted else -1)
        return evaluator.obliged(self.kind, search.alternative, what, instance.env, frame)

    def breaches(self, rule: ast.Rule) -> Sequence[ast.Alternative]:  # noqa: ARG002
        """Whatever breaks the rule through a state that holds, or may, however briefly."""
        return ()

    # ---- foresight

    @abstractmethod
    def foresight(self, look: Look, rule: ast.Rule, what: ast.Alternative) -> Foresight:
        """How much must be recorded after a violation before it is certain."""


def nearest_run(held: Band, lasting: Window) -> tuple[float, float, int]:
    """How near a condition comes to holding for long enough.

    Args:
        held: (N,) margins; N > 0.
        lasting: how long is enough.

    Returns:
        The greatest margin that it certainly, and possibly, keeps for so long; and the frame that
        decides.
    """
    low = held_from(held.lower, lasting)
    exact = held.exact and lasting.loose is lasting
    high = low if exact else held_from(held.upper, lasting.loose)
    start, values = int(low.argmax()), held.lower
    surely = possibly = float(low[start])
    if high is not low:
        start_high = int(high.argmax())
        possibly = float(high[start_high])
        if not surely >= 0:
            start, values, lasting = start_high, held.upper, lasting.loose
    frame = start + int(values[start : lasting.stop(start)].argmin())
    return surely, possibly, frame
