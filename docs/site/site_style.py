"""The site's style sheet, in the colours of the whole project."""

from __future__ import annotations

from safestage_eval.palette import GROUNDS, INKS, VERDICTS

RULES = """\
.md-typeset table:not([class]) { display: table; font-size: .68rem; }
.md-typeset .md-typeset__table { display: block; overflow-x: auto; }
.md-typeset table:not([class]) th { min-width: 3rem; }
.md-typeset table:not([class]) td:first-child code { white-space: nowrap; }
.md-typeset code .whole { white-space: nowrap; }
.md-grid { max-width: 72rem; }
.md-typeset .cell-output { overflow-x: auto; margin: 1em 0; }
.md-typeset img { border-radius: 4px; }
.md-typeset pre > code { font-size: .66rem; }
.md-typeset h3.doc-heading { font-size: .9rem; }
.md-typeset table:not([class]) thead:not(:has(th:not(:empty))) { display: none; }
@media (max-width: 600px) {
  .md-typeset table:not([class]) :is(th, td) { padding: .5em .6em; }
  .md-typeset p:has(> img[src$=".svg"]) { overflow-x: auto; }
  .md-typeset p > img[src$=".svg"] { max-width: none; width: 32rem; }
}
/* drawings on a dark page: light and dark change places, hues stay */
[data-md-color-scheme="slate"] .md-typeset img[src$=".svg"] { background: #fff; padding: .3rem; filter: invert(.89) hue-rotate(180deg); }
"""


def style_sheet() -> str:
    """Variables of Material from the palette, for light and dark, and a few rules."""
    parts = []
    for scheme, side in (("default", "light"), ("slate", "dark")):
        ink = {name: getattr(pair, side) for name, pair in {**INKS, **GROUNDS}.items()}
        bar = INKS["accent"].light if side == "light" else GROUNDS["surface"].dark
        parts.append(
            f'[data-md-color-scheme="{scheme}"] {{\n'
            f"  --md-primary-fg-color: {bar};\n"
            f"  --md-primary-fg-color--light: {bar};\n"
            f"  --md-primary-fg-color--dark: {bar};\n"
            "  --md-primary-bg-color: #ffffff;\n"
            "  --md-primary-bg-color--light: #ffffffcc;\n"
            f"  --md-accent-fg-color: {ink['accent']};\n"
            f"  --md-typeset-a-color: {ink['accent']};\n"
            f"  --md-default-bg-color: {ink['surface']};\n"
            f"  --md-default-fg-color: {ink['ink']};\n"
            f"  --md-default-fg-color--light: {ink['ink-soft']};\n"
            f"  --md-code-bg-color: {ink['sunken']};\n"
            f"  --safestage-violation: {getattr(VERDICTS['violation'], side)};\n"
            f"  --safestage-pass: {getattr(VERDICTS['pass'], side)};\n"
            "}\n"
        )
    return "\n".join(parts) + RULES
