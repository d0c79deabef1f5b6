"""Each kind of obligation in a file: its margin, witness, words, and how far it looks ahead."""

from safestage_eval.rules.clauses import ClauseKind

from .forbid import Forbid
from .obligation import Margin, Obligation
from .reach import Reach
from .require import Require

OBLIGATIONS: dict[ClauseKind, Obligation] = {
    kind.kind: kind for kind in (Require(), Forbid(), Reach())
}

__all__ = ["OBLIGATIONS", "Margin", "Obligation"]
