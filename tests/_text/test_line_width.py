"""Lines are folded between words, and hang under their last column."""

from hypothesis import given
from hypothesis import strategies as st

from safestage_eval._text.line_width import fold, folded

WORDS = st.lists(st.text("abcdefg_/.→ä", min_size=1, max_size=12), min_size=1, max_size=40)
SPACES = st.integers(0, 6)


@given(WORDS, SPACES, st.integers(24, 90))
def test_no_line_is_longer_and_no_word_is_lost_or_broken(words, indent, width):
    line = " " * indent + " ".join(words)
    lines = fold(line, width)
    assert max(map(len, lines)) <= width
    assert " ".join(lines).split() == words


def test_a_line_that_fits_stays_as_it_is():
    assert fold("  name   a  sentence  ", 80) == ["  name   a  sentence  "]
    assert fold("x " * 100, None) == ["x " * 100]


def test_what_follows_hangs_under_the_last_column():
    assert fold("  why    one two three four", 20) == ["  why    one two", "         three four"]


def test_a_word_that_is_longer_than_a_line_stays_whole():
    assert fold("in /a/very/long/path here", 10) == ["in", "/a/very/long/path", "  here"]


def test_wide_letters_count_twice():
    assert fold("机器 人人", 5) == ["机器", " 人人"]


def test_lines_of_a_text_are_folded_each_by_itself():
    assert folded("a b\n\nc", 2) == "a\nb\n\nc"
