"""Values of parameters as a command is given them."""

import pytest

from safestage_eval.errors import RuleError
from safestage_eval.rules.overrides import parse_settings


def test_settings_as_words_of_a_command() -> None:
    assert parse_settings(["edge=3 cm", "hold = 2 s", "edge=4 cm"]) == {
        "edge": "4 cm",
        "hold": "2 s",
    }
    for text in ("edge", "edge=", "=3 cm", "Edge=3 cm"):
        with pytest.raises(RuleError, match="name=value"):
            parse_settings([text])
