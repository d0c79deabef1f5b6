"""The colours of the whole project, each for light and for dark grounds.

Verdicts have a colour and a sign; roles have an outline and a hatching, in ink, or where that cannot be
drawn a paint that no verdict has: what is protected never looks like what is violated. Verdicts and series are built on the
hues of Okabe and Ito ("Color Universal Design", 2008), darker or lighter until they can be read as
text: a contrast of at least 4.5 : 1 with every ground, of 3 : 1 for marks. Blue against vermilion is
told apart by all kinds of colour-blind readers; even so no verdict is ever a colour alone.
"""

from __future__ import annotations

from typing import NamedTuple


class Pair(NamedTuple):
    """``#rrggbb`` on light and on dark grounds."""

    light: str
    dark: str


GROUNDS = {
    "ground": Pair("#f6f7f7", "#13171b"),
    "surface": Pair("#ffffff", "#1b2026"),
    "sunken": Pair("#eff1f2", "#161a1f"),
}
"""Background colours."""

INKS = {
    "line": Pair("#d8dcdf", "#343b44"),
    "line-strong": Pair("#7d868f", "#7c8793"),
    "ink": Pair("#191d21", "#eceef0"),
    "ink-soft": Pair("#515a63", "#aab3bc"),
    "accent": Pair("#4a3fb0", "#b6adff"),
    "accent-soft": Pair("#ecebfa", "#292646"),
    "on-accent": Pair("#ffffff", "#15122e"),
}
"""Text, lines, and what can be pressed."""

VERDICTS = {
    "pass": Pair("#00668a", "#63c4e8"),
    "violation": Pair("#ae360b", "#ff9a6e"),
    "inconclusive": Pair("#755500", "#e6bf57"),
    "not_applicable": Pair("#555e67", "#a4adb6"),
}
"""Verdict → text and marks."""

SOFT = {
    "pass": Pair("#e1f1f7", "#12303c"),
    "violation": Pair("#fdeae2", "#43210f"),
    "inconclusive": Pair("#f8f0d6", "#382c0a"),
    "not_applicable": Pair("#eceef0", "#282e35"),
}
"""Verdict → the ground of its text."""

SIGNS = {"violation": "✕", "pass": "✓", "inconclusive": "?", "not_applicable": "–"}
"""Verdict → its sign, which stands wherever its colour does."""

TERMINAL = {
    "violation": "#cc3311",
    "pass": "#0a7fc2",
    "inconclusive": "#8f7000",
    "not_applicable": "#767d85",
}
"""Verdict → text in a terminal, whose ground nobody knows: 4 : 1 or more on white and on black."""

OUTCOMES = {
    "safe-success": VERDICTS["pass"],
    "unsafe-success": VERDICTS["violation"],
    "safe-failure": Pair("#6f8794", "#8aa0ad"),
    "unsafe-failure": Pair("#80265c", "#d98bbd"),
}
"""Success × safety."""

SERIES = (
    Pair("#0063a0", "#6ab6f0"), Pair("#b8500a", "#f2a065"), Pair("#00775a", "#45c9a2"),
    Pair("#9c3f80", "#e79dcd"), Pair("#806000", "#dcbb4e"), Pair("#4f5a66", "#b3bdc8"),
)  # fmt: skip
"""Several lines in one drawing, in this order."""

HATCHINGS = {
    "target": "rising",
    "protected": "cross",
    "fragile": "cross",
    "forbidden": "cross",
    "dependent": "falling",
    "destination": "dots",
    "container": "dots",
    "bystander": "level",
}
"""Role → hatching of a body that plays it, inside an outline; other roles have the outline alone."""

PAINTS = {
    "target": "#56b4e9",
    "protected": "#cc79a7",
    "fragile": "#cc79a7",
    "forbidden": "#cc79a7",
    "dependent": "#f0e442",
    "destination": "#009e73",
    "container": "#009e73",
    "bystander": "#8a7fb8",
    "pier": "#a3a3a3",
}
"""Role → colour in pictures and films, where nothing can be hatched; no verdict has any of these."""

SURFACES = {
    "robot": Pair("#e2e4e7", "#c4c9cf"),
    "gripper": Pair("#737b85", "#868e99"),
    "fixture": Pair("#cdbfaa", "#8d8271"),
    "object": Pair("#d9c48e", "#c0ab76"),
    "region": Pair("#8f9bb3", "#8f9bb3"),
    "floor": Pair("#b9bec4", "#4a5058"),
    "sky": Pair("#e3e9ee", "#22282f"),
}
"""Kind of body → its surface in 3-D; muted, so that a violation stands out."""


MARK_INK = Pair("#20262c", "#14181c")
"""Outlines and hatchings of roles on those surfaces."""


def fractions(colour: str) -> tuple[float, float, float]:
    """Red, green and blue of ``#rrggbb``, each 0 … 1."""
    r, g, b = (int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5))
    return r, g, b


def custom_properties() -> str:
    """The palette as a style sheet: ``--violation: light-dark(#ae360b, #ff9a6e);`` and so on."""
    named = {
        **GROUNDS,
        **INKS,
        **{name.replace("_", "-"): pair for name, pair in VERDICTS.items()},
        **{f"{name.replace('_', '-')}-soft": pair for name, pair in SOFT.items()},
        **OUTCOMES,
        **{f"series-{i}": pair for i, pair in enumerate(SERIES, 1)},
        **{f"kind-{name}": pair for name, pair in SURFACES.items()},
        "mark-ink": MARK_INK,
    }
    lines = (f"  --{name}: light-dark({light}, {dark});" for name, (light, dark) in named.items())
    return ":root {\n  color-scheme: light dark;\n" + "\n".join(lines) + "\n}\n"
