"""Guesses from the names of bodies: materials, tags, round things, sides of fingers."""

from __future__ import annotations

import re

GROUPS: tuple[tuple[str, str | None, tuple[str, ...]], ...] = (
    ("wineglass glass goblet tumbler carafe lightbulb", "glass", ("fragile",)),
    ("vase teacup teapot figurine", "ceramic", ("fragile",)),
    ("mug cup saucer ramekin porcelain", "ceramic", ("fragile",)),
    ("plate bowl dish", "ceramic", ()),
    ("bottle", "bottle", ()),
    ("egg", None, ("fragile",)),
    ("phone smartphone laptop tablet keyboard camera headphones monitor radio", "electronics", ("electronics", "fragile")),
    ("apple orange lemon lime pear peach banana tomato avocado onion potato mango", "fruit", ()),
    ("book magazine newspaper paper envelope notebook dictionary", "paper", ()),
    ("can tin pan pot skillet moka", "metal", ()),
    ("knife scissors razor cleaver", "metal", ("sharp",)),
    ("kettle iron stove candle", None, ("hot",)),
    ("hammer dumbbell anvil wrench", "metal", ("heavy",)),
    ("bleach detergent", None, ("liquid", "chemical")),
)  # fmt: skip
"""Words → the material and the tags that they suggest; the first group that fits."""

ROUND = frozenset(
    [
        "ball",
        "apple",
        "orange",
        "lemon",
        "lime",
        "peach",
        "tomato",
        "egg",
        "marble",
        "onion",
        "potato",
    ]
)
"""Things without an axis that points up."""

_SIDES = (("left", "l", "1"), ("right", "r", "2"))


def words_of(name: str) -> list[str]:
    """``akita_blackBowl_1_main`` → ``["akita", "black", "bowl", "1", "main"]``."""
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name)
    return re.findall(r"[a-z]+|[0-9]+", spaced.lower())


def suggestion(name: str) -> tuple[str, str | None, tuple[str, ...]] | None:
    """The word of a name that suggests something, the material and the tags; None if none does.

    The last such word counts: a ``glass_plate`` is a plate, a ``cup_holder`` nothing that we know.
    """
    words = [word for word in words_of(name) if len(word) > 1 and word.isalpha()]
    words = [word for word in words if word not in ("main", "body", "link", "base", "object")]
    for word in reversed(words):
        for listed, material, tags in GROUPS:
            if word in listed.split() or word.removesuffix("s") in listed.split():
                return word, material, tags
        if word in ("holder", "rack", "stand", "box", "case", "tray", "board"):
            return None
    return None


def is_round(name: str) -> bool:
    """Whether the name is that of a thing without an axis that points up."""
    return any(word.removesuffix("s") in ROUND for word in words_of(name))


def side_of(name: str) -> tuple[str, bool] | None:
    """``left`` or ``right`` of a finger's name, and whether the name says it in full."""
    words = words_of(name)
    joined = "".join(words)
    if not any(part in joined for part in ("finger", "pad", "jaw", "knuckle")):
        return None
    for side in _SIDES:
        if side[0] in joined:
            return side[0], True
    for side in _SIDES:
        if words and (words[-1] in side[1:] or words[0] in side[1:]):
            return side[0], False
    return None


def mention(name: str, text: str) -> int | None:
    """Where a text mentions a body: the index of the noun of its name; None if it does not.

    The noun is the last word of the name with three letters or more (``red_mug_1``: ``mug``).
    """
    words = words_of(text)
    own = [w for w in words_of(name) if len(w) > 2 and w.isalpha() and w not in ("main", "body")]
    if not own or not words:
        return None
    head = own[-1]
    places = [i for i, word in enumerate(words) if word.removesuffix("s") == head.removesuffix("s")]
    return places[0] if places else None
