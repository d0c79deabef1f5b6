"""What the pages that SafeStage writes or serves have in common: one look, and one safe frame."""

from __future__ import annotations

from .page import THEME_SWITCH, page, part

__all__ = ["THEME_SWITCH", "page", "part"]
