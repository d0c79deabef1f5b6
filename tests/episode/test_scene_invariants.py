"""Bodies that pass at a glance have nothing wrong with them when looked at closely."""

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from safestage_eval.episode.body import Body, Geom
from safestage_eval.episode.scene_invariants import (
    FARTHEST,
    SIZE_COUNTS,
    _body,
    _plainly_sound,
    check_bodies,
)

numbers = st.sampled_from([0.0, 0.1, 1.0, -1.0, 0.6, 0.8, FARTHEST, 2 * FARTHEST]) | st.floats()
usual = st.sampled_from([0.1, 0.2, 0.3])
vectors = st.tuples(usual, usual, usual) | st.tuples(numbers, numbers, numbers)
turns = st.just((1.0, 0.0, 0.0, 0.0)) | st.tuples(numbers, numbers, numbers, numbers)
geoms = st.builds(
    Geom,
    name=st.just("g"),
    kind=st.sampled_from(sorted(SIZE_COUNTS)),
    size=st.lists(usual | numbers, max_size=3).map(tuple),
    position=vectors,
    orientation=turns,
    friction=vectors,
    mesh=st.none() | st.just("m"),
)
bodies = st.builds(
    Body,
    name=st.just("cup"),
    kind=st.just("object"),
    mass=st.none() | usual | numbers,
    com=vectors,
    inertia=st.none() | vectors,
    inertia_orientation=turns,
    up_axis=st.none() | vectors,
    geoms=st.lists(geoms, max_size=2).map(tuple),
)


@settings(max_examples=300)
@given(bodies)
@example(Body(name="cup", kind="object", com=(FARTHEST, 0.0, 0.0)))
def test_a_glance_passes_nothing_that_is_broken(body):
    errors = [str(error) for error in _body(body, "here: body 'cup'")]
    assert not (_plainly_sound(body) and errors)
    assert [str(error) for error in check_bodies([body], "here")] == errors


def test_an_ordinary_body_passes_at_a_glance():
    geom = Geom(name="g", kind="box", size=(0.1, 0.1, 0.1))
    assert _plainly_sound(Body(name="cup", kind="object", mass=0.2, geoms=(geom,)))


def test_a_kind_that_does_not_exist_suggests_the_nearest():
    with pytest.raises(ValidationError) as caught:
        Body(name="a", kind="objct")
    assert caught.value.__notes__ == ["kind: did you mean 'object'?"]
    with pytest.raises(ValidationError) as caught:
        Body(name="a", kind="zzz")
    assert not hasattr(caught.value, "__notes__")
