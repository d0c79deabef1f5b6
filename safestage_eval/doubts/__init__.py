"""What cannot be true of a recording, by what it says twice: found alike by scoring and by the audit.

A check is one function under ``@check`` in a file ``*_doubts.py``; scoring runs those of columns that
its rules read (``columns.AtHand``), the audit all of them.
"""

from .columns import AtHand, Columns
from .find_doubts import contradictions, header_contradictions

__all__ = ["AtHand", "Columns", "contradictions", "header_contradictions"]
