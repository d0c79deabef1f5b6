"""What may have happened between two samples that are more than 50 ms apart is not excluded."""

import pytest
from toy import Facts, judge_toy, series

BOTH = 'given = { any = ["q(b)", { "q(b)" = false }] }'
STATE = '[state.s]\nof = ["x"]\nwhen = {{ "height(x)" = ">= 0 m" }}\nfor = "{}"\n'


def judged(p: str, q: str, rule: str, rate: float) -> tuple[str, str]:
    facts = Facts({"height(a)": series(p), "height(b)": series(q)}, rate=rate, coarse=True)
    found = judge_toy(facts, rule)
    return found.verdict, found.explanation


@pytest.mark.parametrize(("rate", "verdict"), [(2.0, "inconclusive"), (10.0, "inconclusive"),
                                               (20.0, "pass"), (120.0, "pass")])  # fmt: skip
def test_a_scope_that_ends_between_two_samples_may_hold_what_the_second_shows(rate, verdict):
    rule = 'during = "from start to q(b)"\nforbid = "p(a)"'
    assert judged("00001", "00100", rule, rate)[0] == "pass"
    assert judged("01000", "00100", rule, rate)[0] == "violation"
    found, said = judged("00100", "00100", rule, rate)
    assert found == verdict
    if verdict == "inconclusive":
        assert f"ended between two samples that are {1e3 / rate:.0f} ms apart" in said
        assert "Record more frames" in said


@pytest.mark.parametrize(("rate", "verdict"), [(10.0, "inconclusive"), (40.0, "pass")])
def test_one_sample_does_not_show_that_something_lasted(rate, verdict):
    """It must have lasted when p comes: the time of one sample at 10 Hz, of several at 40 Hz."""
    rule = f'forbid = [{{ "p(a)" = true, "s(b)" = false }}]\n{BOTH}\n{STATE.format("0.1 s")}'
    many = round(0.1 * rate)
    p, q = "0" * 3 + "1" + "0" * (many + 3), "000" + "1" * many + "0" * 4
    found, said = judged(p, q, rule, rate)
    assert found == verdict
    if verdict == "inconclusive":
        assert "how long s(b) lasted is not known between two samples that are 100 ms apart" in said
    assert judged(p, "0" * len(q), rule, rate)[0] == "violation"
    assert judged(p, q.replace("0", "1"), rule, rate)[0] == "pass"


@pytest.mark.parametrize(("rate", "verdict"), [(10.0, "inconclusive"), (120.0, "violation")])
def test_what_shows_in_one_sample_may_have_been_long_enough(rate, verdict):
    """s is over once p has lasted for 25 ms; one sample of p may be all of that, if it is coarse."""
    rule = (
        f'forbid = [{{ "q(b)" = true, "s(a)" = false }}]\n{BOTH}\n'
        f"{STATE.format('3 frames @ 120 Hz')}"
    )
    assert judged("00100000", "00100000", rule, rate)[0] == verdict
