"""Texts and lists are put together as pyarrow's own functions would."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st

from safestage_eval.formats.parquet.arrow_values import decoded, flat_values

TRACES = Path(__file__).parents[2] / "traces"


@given(
    st.lists(st.one_of(st.none(), st.text(max_size=5))),
    st.sampled_from([pa.string(), pa.large_string(), pa.binary()]),
    st.integers(0, 3),
)
def test_words_of_a_dictionary(words, kind, start):
    plain = pa.array([None if w is None else w.encode() for w in words], pa.binary())
    coded = plain.cast(kind).dictionary_encode()[start:]
    assert decoded(coded).equals(coded.dictionary_decode())
    decoded(coded).validate(full=True)


@given(
    st.lists(st.one_of(st.none(), st.lists(st.floats(width=32), max_size=4))),
    st.sampled_from([pa.list_, pa.large_list]),
    st.integers(0, 3),
)
def test_numbers_in_lists(rows, kind, start):
    lists = pa.array(rows, kind(pa.float32()))[start:]
    expected = lists.flatten().to_numpy(zero_copy_only=False)
    np.testing.assert_array_equal(flat_values(lists), expected)


def test_opening_an_episode_loads_nothing_to_compute():
    code = (
        "import sys; from safestage_eval.formats import discover; "
        f"ref = next(r for r in discover({str(TRACES)!r}) if r.format == 'parquet'); "
        "ref.open().frames; print(*{'pandas', 'pyarrow.compute'} & {*sys.modules})"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not done.stdout.strip()


@pytest.mark.parametrize("code", [-1, 2])
def test_a_word_that_is_not_in_the_dictionary_is_refused(code):
    words = pa.DictionaryArray.from_arrays(
        pa.array([0, code], pa.int32()), pa.array(["a", "b"]), safe=False
    )
    with pytest.raises(pa.ArrowIndexError):
        decoded(words)
