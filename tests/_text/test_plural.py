import pytest

from safestage_eval._text.plural import count, first_few


@pytest.mark.parametrize(
    ("number", "noun", "said"),
    [(0, "episode", "0 episodes"), (1, "body", "1 body"), (2, "body", "2 bodies")],
)
def test_nouns_follow_their_number(number, noun, said):
    assert count(number, noun) == said


@pytest.mark.parametrize("many", range(1, 6))
def test_each_name_is_written_or_counted(many):
    names = [f"cup{i}" for i in range(many)]
    written, _, rest = first_few(names, 3).partition(" and ")
    assert written.split(", ") == names[:3]
    assert int(rest.removesuffix(" more") or 0) == max(0, many - 3)
