"""The smallest set of differences that flips a verdict, and what is said where it is not sure."""

import itertools

from hypothesis import given
from hypothesis import strategies as st

from safestage_eval.whatif.flip_cause import smallest

FEW = 5


@st.composite
def flipping(draw):
    """Parts, and the sets of them that flip the verdict; all of them together do."""
    parts = "abcdef"[: draw(st.integers(1, FEW))]
    some = draw(st.lists(st.sets(st.sampled_from(parts), min_size=1), max_size=8))
    upwards = draw(st.booleans())  # more never undoes it; or exactly these sets do

    def flips(chosen):
        chosen = set(chosen)
        if upwards:
            return chosen == set(parts) or any(one <= chosen for one in some)
        return chosen == set(parts) or chosen in some

    return parts, flips


def exhausted(parts, flips):
    """Size of the smallest sets that flip, and these."""
    for size in range(1, len(parts) + 1):
        hits = [set(c) for c in itertools.combinations(parts, size) if flips(c)]
        if hits:
            return size, hits
    raise AssertionError


@given(flipping())
def test_with_all_sets_tried_it_is_the_smallest(given):
    parts, flips = given
    size, hits = exhausted(parts, flips)
    found = smallest(parts, flips)
    assert set(found.parts) in hits
    assert (found.alternatives, found.untried) == (len(hits) - 1, None)
    assert len(found.parts) == size
    assert "not all tried" not in str(found)


@given(flipping(), st.integers(0, 2**FEW))
def test_a_search_that_stops_says_what_it_knows(given, most):
    parts, flips = given
    size, hits = exhausted(parts, flips)
    tried = []

    def noted(chosen):
        tried.append(chosen)
        return flips(chosen)

    found = smallest(parts, noted, most)
    assert flips(found.parts)
    if found.untried is None:
        assert set(found.parts) in hits
        return
    assert found.untried <= size or len(found.parts) == size
    assert ("none of fewer" in str(found)) == (len(found.parts) == found.untried)
    # whatever is smaller than the first size that was not all tried was tried, and does not flip
    assert not any(
        flips(c) for n in range(1, found.untried) for c in itertools.combinations(parts, n)
    )
    assert len(found.parts) >= found.untried
    if len(found.parts) > found.untried:  # nothing in it can be left out
        for part in found.parts:
            fewer = [other for other in found.parts if other != part]
            assert not flips(fewer)


def test_four_changes_that_flip_only_together_are_named():
    found = smallest("abcdef", lambda chosen: set("bcde") <= set(chosen))
    assert (found.parts, found.alternatives, found.untried) == (tuple("bcde"), 0, None)
    assert str(found) == "b and c and d and e"


def test_out_of_many_a_set_is_found_and_its_limits_are_reported():
    parts = [f"p{n:02}" for n in range(40)]
    wanted = {"p03", "p07", "p31", "p39"}
    found = smallest(parts, lambda chosen: wanted <= set(chosen))
    assert set(found.parts) == wanted
    assert str(found).endswith("(none can be left out; sets of 2 or more were not all tried)")
