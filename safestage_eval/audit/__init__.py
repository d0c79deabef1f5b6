"""Is this recording sound, is its scene, and is the evaluation that the recordings make?

A check is one function under ``@check`` in a file of ``checks/``; nothing else lists it.
"""

from safestage_eval.doubts.check_registry import CHECKS, Check, Severity, check

from .audit import Audit, audit
from .choose import choose
from .finding import Defect, Finding, Place

__all__ = [
    "CHECKS",
    "Audit",
    "Check",
    "Defect",
    "Finding",
    "Place",
    "Severity",
    "audit",
    "check",
    "choose",
]
