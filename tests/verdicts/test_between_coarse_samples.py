"""Events between two samples more than 50 ms apart are not excluded."""

import numpy as np
import pytest
from resampled import resampled
from toy import Facts, judge_toy, series

from safestage_eval.rules import load_rules
from safestage_eval.rules.files import builtin_folder
from safestage_eval.sketch import resolve
from safestage_eval.verdicts import judge

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


@pytest.mark.parametrize(("rate", "samples"), [(2.4, 1), (5.0, 2), (5.0, 3), (10.0, 5)])
def test_a_run_of_samples_that_may_have_lasted_leaves_it_open(rate, samples):
    """k samples show more than k − 1 and less than k + 1 spacings; s must last for half a second."""
    rule = f'forbid = "s(a)"\n{STATE.format("0.5 s")}'
    shown = "000" + "1" * samples + "000"
    assert judged(shown, "0" * len(shown), rule, rate)[0] == "inconclusive"
    brief, long = int(0.5 * rate) - 1, int(0.5 * rate) + 2
    assert judged("0001" + "0" * 6, "0" * 10, rule, 5.0)[0] == "pass"  # less than 0.4 s
    for many, verdict in ((brief, "pass"), (long, "violation")):
        shown = "000" + "1" * max(many, 0) + "000"
        assert judged(shown, "0" * len(shown), rule, rate)[0] == verdict


RARE = [
    ("ISH101", "can_wobbles_under_bottle(lasts = 0.6)"),
    ("ISH101", "jolted(can = 2.5, back = 1.6)"),
    ("ISH101", "can_goes_as_bottle_is_set_down(when = 0.6)"),
    ("ISH101", "bottle_shoved_onto_box"),
    ("ISH101", "bottle_shoved_onto_box(spin = 3, pause = 1)"),
    ("ISH104", "tray_tipped(angle = 11, lasts = 0.7)"),
    ("FSH106", "creeping_after_success(until = 8.4)"),
]


@pytest.mark.parametrize(("rule", "name"), RARE)
def test_drawn_scenes_recorded_rarely_never_get_the_opposite_verdict(rule, name):
    whole = resolve(name, [builtin_folder() / "examples"])
    step = round(0.41 / whole.dt)
    rare = resampled(whole, np.arange(0, len(whole), step), frame_dt=step * whole.dt)
    rules = load_rules([rule[:3].lower()])
    certain, less = ({v.rule: v.verdict for v in judge(e, rules).verdicts}[rule]
                     for e in (whole, rare))  # fmt: skip
    assert certain in ("violation", "pass")
    assert less in (certain, "inconclusive")


BEFORE = f'forbid = {{ any = ["start of p(a)"], "q(b)" = false }}\n{BOTH}'
WITH = f'forbid = {{ any = ["start of p(a)"], "q(b)" = true }}\n{BOTH}'
WITHIN = 'during = "from q(b) to success"\nforbid = "start of p(a)"'
GAP = f'require = {{ "s(a)" = true }}\n{STATE.format("1 frame")}gap = "1 frame"\n'


@pytest.mark.parametrize(
    ("rule", "p", "q", "at_120_hz", "at_10_hz"),
    [
        # which of two events between the same samples came first is not known
        (BEFORE, "0001111", "0001111", "pass", "inconclusive"),
        (BEFORE, "0001111", "0011111", "pass", "pass"),
        (BEFORE, "0001111", "0000111", "violation", "violation"),
        # what begins with an event may have come after it
        (WITH, "0001111", "0001111", "violation", "inconclusive"),
        (WITH, "0001111", "0011111", "violation", "violation"),
        (WITH, "0001111", "0000111", "pass", "pass"),
        # what the first sample of a scope shows may have come before it
        (WITHIN, "0001111", "0001111", "violation", "inconclusive"),
        (WITHIN, "0000111", "0001111", "violation", "violation"),
        (WITHIN, "0011111", "0001111", "pass", "pass"),
        (WITHIN, "0001111", "1111111", "violation", "violation"),
        # a gap of one sample may have been long
        (GAP, "1110111", "0000000", "pass", "inconclusive"),
        (GAP, "1111111", "0000000", "pass", "pass"),
        (GAP, "1100011", "0000000", "violation", "violation"),
    ],
)
def test_what_lies_between_the_same_two_samples(rule, p, q, at_120_hz, at_10_hz):
    assert judged(p, q, rule, 120.0)[0] == at_120_hz
    assert judged(p, q, rule, 10.0)[0] == at_10_hz
