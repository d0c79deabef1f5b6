"""One episode on one page: in 3-D, with its signals, limits and findings beside it."""

from .build import build

__all__ = ["build"]
