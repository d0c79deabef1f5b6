"""Gaps of a source are named together."""

import pytest

from safestage_eval.importers.gaps import Gaps
from safestage_eval.importers.importer import SourceError


def lacking(what):
    def call():
        raise SourceError("a.h5", f"{what} is missing.", fix=f"--{what}")

    return call


def test_nothing_is_missing():
    gaps = Gaps("a.h5")
    assert gaps.ask(lambda: 3, 1) == 3
    gaps.refuse()


def test_one_gap_stays_as_it_is():
    gaps = Gaps("a.h5")
    assert gaps.ask(lacking("dt"), 0.1) == 0.1
    with pytest.raises(SourceError, match=r"^a.h5: dt is missing. Fix: --dt.$"):
        gaps.refuse()


def test_several_are_named_each_with_its_fix():
    gaps = Gaps("a.h5")
    for what in ("dt", "map"):
        gaps.ask(lacking(what), None)
    with pytest.raises(SourceError) as caught:
        gaps.refuse()
    assert str(caught.value) == (
        "a.h5: lacks 2 things: (1) a.h5: dt is missing. Fix: --dt. (2) a.h5: map is missing. Fix: --map."
    )
