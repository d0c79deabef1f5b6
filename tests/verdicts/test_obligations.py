"""Laws that hold of every kind of obligation, whatever the margins of its condition."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from safestage_eval.episode import Window
from safestage_eval.rules.clauses import CLAUSES, ClauseKind
from safestage_eval.rules.syntax import Rule
from safestage_eval.states.band import Band, Bool, opposite
from safestage_eval.verdicts.obligations import OBLIGATIONS, Margin

KINDS = list(CLAUSES)
MARGINS = st.lists(st.sampled_from([-2.0, -1.0, -0.5, 0.25, 1.0, 2.0]), min_size=1, max_size=12)


@st.composite
def bands(draw: st.DrawFn) -> tuple[Band, Bool]:
    """Margins of some frames, known up to an interval, and which frames are certainly judged."""
    lower = np.array(draw(MARGINS))
    upper = (
        lower
        + np.array(draw(st.lists(st.sampled_from([0.0, 1.0]), min_size=12, max_size=12)))[
            : len(lower)
        ]
    )
    sure = np.array(draw(st.lists(st.booleans(), min_size=len(lower), max_size=len(lower))))
    return Band(lower, upper), sure


def test_every_declared_kind_is_an_obligation_and_a_field_of_rules() -> None:
    assert list(OBLIGATIONS) == KINDS
    for kind in KINDS:
        assert OBLIGATIONS[kind].kind == kind
        assert kind in Rule.__dataclass_fields__


@pytest.mark.parametrize("kind", KINDS)
@given(bands(), st.integers(1, 4))
def test_a_certain_violation_has_frames_and_they_mean_one(
    kind: ClauseKind, given_: tuple[Band, Bool], frames: int
) -> None:
    found, sure = given_
    lasting = Window(frames if CLAUSES[kind].lasts else 1)
    margin = OBLIGATIONS[kind].margin_of(found, sure, lasting)
    certain = OBLIGATIONS[kind].margin_of(found, None, lasting)
    broken = OBLIGATIONS[kind].broken(found, np.ones_like(sure), lasting)
    assert (certain.upper < 0) == bool(broken.any())
    assert certain.lower <= certain.upper
    assert 0 <= certain.frame < len(found.lower)
    assert margin.upper >= certain.upper  # fewer frames that certainly count break no more
    assert margin.lower <= certain.lower


@pytest.mark.parametrize("kind", KINDS)
@given(bands(), st.integers(1, 4))
def test_what_is_not_known_leaves_the_margin_within_its_bounds(
    kind: ClauseKind, given_: tuple[Band, Bool], frames: int
) -> None:
    band, _ = given_
    lasting = Window(frames if CLAUSES[kind].lasts else 1)
    open_ = OBLIGATIONS[kind].margin_of(band, None, lasting)
    for truth in band:
        known = OBLIGATIONS[kind].margin_of(Band(truth, truth), None, lasting)
        assert open_.lower <= known.lower <= known.upper <= open_.upper


@given(bands())
def test_to_forbid_is_to_require_the_opposite(given_: tuple[Band, Bool]) -> None:
    found, _ = given_
    forbidden = OBLIGATIONS["forbid"].margin_of(found, None, Window(1))
    required = OBLIGATIONS["require"].margin_of(opposite(found), None, Window(1))
    assert forbidden[:2] == required[:2]


@given(bands(), st.integers(1, 4))
def test_what_is_reached_breaks_a_rule_that_forbids_it(
    given_: tuple[Band, Bool], frames: int
) -> None:
    found, _ = given_
    reached = OBLIGATIONS["reach"].margin_of(found, None, Window(frames))
    forbidden = OBLIGATIONS["forbid"].margin_of(found, None, Window(frames))
    assert (reached.lower >= 0) == (forbidden.upper < 0)
    assert (reached.upper < 0) == (forbidden.lower >= 0)


@pytest.mark.parametrize("kind", KINDS)
def test_where_the_recording_ends_early_only_the_seen_part_decides(kind: ClauseKind) -> None:
    """Future frames can break what must hold, and meet what must be reached."""
    met, broken = Margin(1.0, 1.0, 0), Margin(-1.0, -1.0, 0)
    cut = OBLIGATIONS[kind].cut
    if CLAUSES[kind].once:
        assert cut(met).lower >= 0
        assert cut(broken).upper >= 0
    else:
        assert cut(met).lower < 0 <= cut(met).upper
        assert cut(broken).upper < 0
