"""Figures by matplotlib, which is an extra: check for it, write a figure."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from safestage_eval.errors import InputError
from safestage_eval.formats.atomic import writing


def ready(option: str, path: Path) -> None:
    """Check that matplotlib is installed, before anything is measured.

    Raises InputError, which names the option: matplotlib is not installed.
    """
    try:
        import matplotlib  # noqa: F401, ICN001
    except ImportError:
        raise InputError(
            f"{option} {path}",
            "drawing needs matplotlib, which is not installed.",
            fix="pip install 'safestage[plot]', or in a checkout pip install -e '.[plot]'",
        ) from None


def write(figure: Any, option: str, path: Path) -> None:
    """Write a figure in the format that the path's ending names, and close it.

    Raises InputError, which names the option: no such format, or the file cannot be written.
    """
    from matplotlib import pyplot as plt

    try:
        with writing(path) as part:
            figure.savefig(part, dpi=160, format=path.suffix[1:].lower() or "png")
    except (ValueError, OSError) as error:
        allowed = ", ".join(sorted(figure.canvas.get_supported_filetypes()))
        reason = str(error).partition(" (supported")[0]
        raise InputError(f"{option} {path}", f"{reason}.", f"a name ending in {allowed}") from None
    finally:
        plt.close(figure)
