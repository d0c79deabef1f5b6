"""Lines of TOML files that people complete: guesses with their reasons."""

from __future__ import annotations

import json
from typing import Any

from safestage_eval._text.printable import printable

from .guess_roles import Guess


def guess_line(key: str, guess: Guess, column: int) -> str:
    """``key = value``, and from a column on how sure the guess is, and why."""
    line = f"{key} = {toml_value(guess.value)}"
    return f"{line:<{column}}  # {guess.confidence}: {printable(guess.reason)}"


def toml_key(name: str) -> str:
    """A key, in quotes where TOML asks for them."""
    plain = name.isascii() and name.replace("_", "").replace("-", "").isalnum()
    return name if plain else toml_value(name)


def toml_value(value: Any) -> str:
    """A text, number, truth value or list of these, in printable characters."""
    if isinstance(value, list):
        return f"[{', '.join(map(toml_value, value))}]"
    text = json.dumps(value, ensure_ascii=False)
    return "".join(c if c.isprintable() else f"\\U{ord(c):08X}" for c in text)
