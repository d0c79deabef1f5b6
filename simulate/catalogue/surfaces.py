"""Surfaces and their friction: what slides on what, and how hard.

MuJoCo, and the evaluator with it, takes the greater friction of the two geoms that touch. So the rougher
surface of a pair decides, and a surface's own value is what two alike have on each other. ``HANDBOOK``
holds ranges of pairs and ``tests/simulate/test_surfaces.py`` holds the values against them. The ranges were
written down from memory of the sources that they name: those of metals, of glass on metal and of rubber were
compared with public copies of such tables, the others were not.

A pair that is slipperier than either surface on its own kind cannot be had so: paper on steel has 0.35
here, and 0.2 to 0.3 in handbooks. Friction of a pair by itself would need explicit contact pairs of
geoms (a tumbler on a tumbler: 289), and a trace has room for one value per geom.
"""

from __future__ import annotations

from typing import NamedTuple

SURFACES = {
    "rubber": 1.0,
    "foam": 0.7,  # chosen: between rubber and felt
    "bread": 0.6,  # chosen: a dry crust, soft
    "cork": 0.6,  # chosen: sold as a layer against slipping; with a weave, below rubber
    "skin": 0.6,  # dry, of a hand: 0.3 to 0.9 on smooth things [Derler & Gerhardt 2012]
    "cardboard": 0.5,
    "cloth": 0.45,
    "felt": 0.5,  # chosen: above woven cloth
    "plush": 0.5,  # chosen: as felt
    "fruit": 0.45,
    "wicker": 0.45,  # chosen: unfinished wood
    "wood": 0.4,
    "glass": 0.4,
    "ceramic": 0.4,  # glazed: a glass
    "stone": 0.4,
    "tape": 0.4,  # chosen: the back of it, as on wood
    "egg": 0.35,  # chosen: lime, a little rough, on smooth things
    "metal": 0.35,
    "plastic": 0.3,
    "paper": 0.3,
    "soap": 0.07,  # wet; decides only on a soapy partner
    "soapy_steel": 0.07,
}
"""Sliding friction of two alike. Between clean and dry, and touched by hands: both are kitchen and desk."""

SAME = {"bottle": "glass", "electronics": "plastic", "marble": "stone", "steel": "metal"}
"""Materials by whose names rules set limits → their surfaces."""

TORSION = 0.005
"""m, torsional over sliding friction: 2/3 of the radius of a round patch under even pressure [Johnson,
Contact Mechanics, 1985], 7.5 mm; flat things turn against several points besides."""
ROLLING = 0.001
"""m, what is not said of an object or its support: hard things on wood and felt."""


def friction(surface: str, rolling: float = ROLLING) -> tuple[float, float, float]:
    """Sliding (-), torsional (m) and rolling friction (m) of a surface."""
    slide = SURFACES[surface]
    return slide, TORSION * slide, rolling


class Pair(NamedTuple):
    """Range of a pair's friction in a handbook, from sliding and touched by hands to clean and at rest."""

    first: str
    second: str
    least: float
    most: float
    source: str


TOOLBOX = "Engineering ToolBox, Friction coefficients"
CRC = "CRC Handbook of Chemistry and Physics, Coefficient of friction"
LOADS = "EN 12195-1:2010, annex B"
TEXTBOOK = "Serway & Jewett, Physics for Scientists and Engineers, table 5.1"

HANDBOOK = (
    Pair("glass", "glass", 0.1, 1.0, f"{TOOLBOX}: greasy 0.1–0.6, sliding 0.4, clean 0.9–1.0"),
    Pair("glass", "metal", 0.2, 0.7, f"{TOOLBOX}; {CRC}: greasy 0.2–0.3, clean 0.5–0.7"),
    Pair("metal", "metal", 0.16, 0.8, f"{TOOLBOX}; {CRC}: greasy 0.16, sliding 0.42, clean 0.8"),
    Pair("wood", "wood", 0.25, 0.5, f"{TOOLBOX}; {CRC}: clean and dry"),
    Pair("wood", "metal", 0.2, 0.6, f"{TOOLBOX}; {CRC}: clean and dry"),
    Pair("wood", "stone", 0.2, 0.4, TOOLBOX),
    Pair("glass", "wood", 0.2, 0.6, f"as metal; glass on wood 0.2–0.5: {TEXTBOOK}"),
    Pair("plastic", "metal", 0.2, 0.5, f"{TOOLBOX}: polythene 0.2, polystyrene 0.35, acrylic 0.5"),
    Pair("plastic", "plastic", 0.2, 0.8, f"{TOOLBOX}: polythene 0.2, polystyrene 0.5, acrylic 0.8"),
    Pair("cardboard", "wood", 0.4, 0.6, f"{LOADS}: 0.5"),
    Pair("cardboard", "cardboard", 0.4, 0.6, f"{LOADS}: 0.5"),
    Pair("rubber", "cardboard", 0.5, 1.0, f"{TOOLBOX}: 0.5–0.8; the pads of the model have 1"),
    Pair("rubber", "rubber", 0.8, 1.16, TOOLBOX),
    Pair("rubber", "stone", 0.6, 1.0, f"{TOOLBOX}: on dry concrete 0.6–0.85; {TEXTBOOK}: 1.0"),
    Pair("cloth", "wood", 0.3, 0.6, f"{TOOLBOX}: leather 0.3–0.6, cotton on cotton 0.3"),
    Pair("soap", "soapy_steel", 0.05, 0.16, f"{TOOLBOX}: lubricated metals"),
)
