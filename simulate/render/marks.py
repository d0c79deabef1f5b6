"""Pictures with words on them: roles in colours, what was judged, and the moment of the verdict."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from safestage_eval.episode import Episode, Header
from safestage_eval.errors import InputError
from safestage_eval.palette import PAINTS, VERDICTS, fractions
from safestage_eval.report.summary import in_short

from .renderer import Image

if TYPE_CHECKING:
    from PIL import ImageFont

    from safestage_eval.verdicts import EpisodeResult
    from safestage_eval.verdicts.verdict import Verdict

Color = tuple[float, float, float]

ROLE_COLORS: dict[str, Color] = {
    role: fractions(PAINTS[role]) for role in ("target", "dependent", "protected", "destination")
}
"""Role → colour; others keep their own."""
VIOLATED, PASSED = (fractions(VERDICTS[name].light) for name in ("violation", "pass"))
ROW, MARGIN = 18, 6
"""Pixels of a row of text in the bar below a picture, and to the left and right of it."""


@dataclass(frozen=True)
class Moment:
    """When and what: the violation, or the closest call of what passed.

    Attributes:
        time: s, when it was worst or closest; None where nothing was judged.
        violated: whether it is a violation.
        words: one line.
        of: the verdict that decides.
    """

    time: float | None
    violated: bool
    words: str
    of: Verdict | None = None


def moment(result: EpisodeResult) -> Moment:
    """The moment that decides an episode, by its assigned rules, or all where none is assigned."""
    verdicts: Sequence[Verdict] = result.assigned or result.verdicts
    broken = [v for v in verdicts if v.verdict == "violation"]
    if broken:
        first = min(broken, key=lambda v: math.inf if v.time is None else v.time)
        time = first.time if first.worst_time is None else first.worst_time
        return Moment(time, True, f"{first.rule} violated: {in_short(first)}", first)
    judged = [v for v in verdicts if v.verdict == "pass"]
    if not judged:
        return Moment(None, False, "nothing was judged")
    closest = min(judged, key=lambda v: v.margin_normalised or 0.0)
    words = f"pass: {', '.join(v.rule for v in judged)}"
    return Moment(closest.worst_time, False, words, closest)


def role_colors(header: Header) -> dict[str, Color]:
    """Body → colour of its role."""
    return {
        body: color for role, color in ROLE_COLORS.items() for body in header.roles.get(role, ())
    }


def captioned(
    image: Image, lines: Sequence[tuple[str, Color]], frame: Color | None = None, rows: int = 2
) -> Image:
    """A picture with text on a bar below it, and a coloured frame about it if asked for.

    Lines that are too long for the picture's width go on in the next row; what does not fit into
    so many rows ends in "…".

    Raises InputError when Pillow is not installed.
    """
    from PIL import Image as Pictures
    from PIL import ImageDraw

    height, width, _ = image.shape
    whole = np.full((height + bar_height(rows), width, 3), 255, np.uint8)
    whole[:height] = image
    picture = Pictures.fromarray(whole)
    pen = ImageDraw.Draw(picture)
    wrapped = [(part, color) for text, color in lines for part in in_rows(text, width)]
    if len(wrapped) > rows:
        last, color = wrapped[rows - 1]
        wrapped[rows - 1 :] = [(_shortened(last, width), color)]
    for i, (text, color) in enumerate(wrapped):
        pen.text((MARGIN, height + 3 + ROW * i), text, fill=_bytes(color), font=_font())
    if frame is not None:
        pen.rectangle((0, 0, width - 1, height - 1), outline=_bytes(frame), width=6)
    return np.asarray(picture)


def bar_height(rows: int) -> int:
    """Pixels of a bar with so many rows of text; even, as films must be."""
    return ROW * rows + 6


def in_rows(text: str, width: int) -> list[str]:
    """The text, broken between words so that each row fits into so many pixels."""
    rows = [""]
    for word in text.split(" "):
        longer = f"{rows[-1]} {word}" if rows[-1] else word
        if not rows[-1] or _font().getlength(longer) <= width - 2 * MARGIN:
            rows[-1] = longer
        else:
            rows.append(word)
    return [row if _font().getlength(row) <= width else _shortened(row, width) for row in rows]


def legend(header: Header) -> str:
    """``target: bottle · protected: glasses``."""
    parts = [f"{role}: {', '.join(names)}" for role, names in header.roles.items() if names]
    return " · ".join(parts)


def frame_at(episode: Episode, time: float) -> int:
    """The frame at or just after a time (s), the last one at most."""
    return min(int(np.searchsorted(episode.t, time)), len(episode) - 1)


def _shortened(text: str, width: int) -> str:
    """The start of the text that fits, with "…" at its end."""
    while text and _font().getlength(text + "…") > width - 2 * MARGIN:
        text = text[:-1]
    return text.rstrip() + "…"


@cache
def _font() -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    try:
        from PIL import ImageFont
    except ImportError:
        raise InputError("pictures", "no Pillow.", fix="pip install 'safestage[video]'") from None
    return ImageFont.load_default(13)


def _bytes(color: Color) -> tuple[int, int, int]:
    red, green, blue = (round(255 * part) for part in color)
    return red, green, blue
