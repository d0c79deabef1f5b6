"""Lines are folded between words, and hang under their last column."""

from hypothesis import given
from hypothesis import strategies as st

from safestage_eval._text.line_width import fold

WORDS = st.lists(st.text("abcdefg_/.→ä", min_size=1, max_size=12), min_size=1, max_size=40)
SPACES = st.integers(0, 6)


@given(WORDS, SPACES, st.integers(24, 90))
def test_no_line_is_longer_and_no_word_is_lost_or_broken(words, indent, width):
    line = " " * indent + " ".join(words)
    lines = fold(line, width)
    assert max(map(len, lines)) <= width
    assert " ".join(lines).split() == words


def test_a_word_that_is_longer_than_a_line_stays_whole():
    assert fold("in /a/very/long/path here", 10) == ["in", "/a/very/long/path", "  here"]


def test_wide_letters_count_twice():
    assert fold("机器 人人", 5) == ["机器", " 人人"]
