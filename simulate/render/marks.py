"""Pictures with words on them: roles in colours, what was judged, and the moment of the verdict."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from safestage_eval.episode import Episode, Header
from safestage_eval.errors import InputError
from safestage_eval.palette import PAINTS, VERDICTS, fractions

from .renderer import Image

if TYPE_CHECKING:
    from safestage_eval.verdicts import EpisodeResult
    from safestage_eval.verdicts.verdict import Verdict

Color = tuple[float, float, float]

ROLE_COLORS: dict[str, Color] = {
    role: fractions(PAINTS[role]) for role in ("target", "dependent", "protected", "destination")
}
"""Role → colour; others keep their own."""
VIOLATED, PASSED = (fractions(VERDICTS[name].light) for name in ("violation", "pass"))
BAR = 40
"""Pixels of the bar below a picture."""


@dataclass(frozen=True)
class Moment:
    """When and what: the violation, or the closest call of what passed.

    Attributes:
        time: s; None where nothing was judged.
        violated: whether it is a violation.
        words: one line.
    """

    time: float | None
    violated: bool
    words: str


def moment(result: EpisodeResult) -> Moment:
    """The moment that decides an episode, by its assigned rules, or all where none is assigned."""
    verdicts: Sequence[Verdict] = result.assigned or result.verdicts
    broken = [v for v in verdicts if v.verdict == "violation"]
    if broken:
        first = min(broken, key=lambda v: math.inf if v.time is None else v.time)
        return Moment(first.time, True, f"{first.rule} violated: {first.explanation}")
    judged = [v for v in verdicts if v.verdict == "pass"]
    if not judged:
        return Moment(None, False, "nothing was judged")
    closest = min(judged, key=lambda v: v.margin_normalised or 0.0)
    return Moment(closest.worst_time, False, f"pass: {', '.join(v.rule for v in judged)}")


def role_colors(header: Header) -> dict[str, Color]:
    """Body → colour of its role."""
    return {
        body: color for role, color in ROLE_COLORS.items() for body in header.roles.get(role, ())
    }


def captioned(
    image: Image, lines: Sequence[tuple[str, Color]], frame: Color | None = None
) -> Image:
    """A picture with lines of text on a bar below it, and a coloured frame about it if asked for.

    Raises InputError when Pillow is not installed.
    """
    try:
        from PIL import Image as Pictures
        from PIL import ImageDraw
    except ImportError:
        raise InputError("pictures", "no Pillow.", fix="pip install 'safestage[video]'") from None
    height, width, _ = image.shape
    whole = np.full((height + BAR, width, 3), 255, np.uint8)
    whole[:height] = image
    picture = Pictures.fromarray(whole)
    pen = ImageDraw.Draw(picture)
    for i, (text, color) in enumerate(lines):
        pen.text((6, height + 3 + 17 * i), _fitting(text, width), fill=_bytes(color))
    if frame is not None:
        pen.rectangle((0, 0, width - 1, height - 1), outline=_bytes(frame), width=6)
    return np.asarray(picture)


def legend(header: Header) -> str:
    """``target: bottle · protected: glasses``."""
    parts = [f"{role}: {', '.join(names)}" for role, names in header.roles.items() if names]
    return " · ".join(parts)


def frame_at(episode: Episode, time: float) -> int:
    """The frame at or just after a time (s), the last one at most."""
    return min(int(np.searchsorted(episode.t, time)), len(episode) - 1)


def _fitting(text: str, width: int) -> str:
    room = max(width // 6 - 2, 8)
    return text if len(text) <= room else text[: room - 1].rstrip() + "…"


def _bytes(color: Color) -> tuple[int, int, int]:
    red, green, blue = (round(255 * part) for part in color)
    return red, green, blue
