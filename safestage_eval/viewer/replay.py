"""The script that draws a film of an episode on a canvas."""

from __future__ import annotations

from pathlib import Path


def script() -> str:
    """JavaScript that defines ``SafestageReplay``, which draws a film on a canvas (``replay.js``)."""
    here = Path(__file__).parent
    parts = [(here / name).read_text(encoding="utf-8") for name in ("shapes.js", "replay.js")]
    return '(() => {\n"use strict";\n' + "\n".join(parts) + "})();\n"
