"""Words in records that are misspelt."""

import pytest
from pydantic import ValidationError

from safestage_eval.episode.body import Body


def test_a_kind_that_does_not_exist_suggests_the_nearest():
    with pytest.raises(ValidationError) as caught:
        Body(name="a", kind="objct")
    assert caught.value.__notes__ == ["kind: did you mean 'object'?"]
    with pytest.raises(ValidationError) as caught:
        Body(name="a", kind="zzz")
    assert not hasattr(caught.value, "__notes__")
