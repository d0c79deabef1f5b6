"""An episode for the eye: shapes and poses in a compact file, and what draws it in a browser."""

from .camera import Look, look_at
from .film import RATE, film
from .surface import outer

__all__ = ["RATE", "Look", "film", "look_at", "outer", "script"]


def script() -> str:
    """JavaScript that defines ``SafestageReplay``, which draws a film on a canvas (``replay.js``)."""
    from pathlib import Path

    here = Path(__file__).parent
    parts = [(here / name).read_text(encoding="utf-8") for name in ("shapes.js", "replay.js")]
    return '(() => {\n"use strict";\n' + "\n".join(parts) + "})();\n"
