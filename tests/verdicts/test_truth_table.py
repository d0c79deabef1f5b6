"""The rule language's truth table, and the laws of margins, over given series."""

import itertools
import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sampled import tries
from scenes import G, Scene
from toy import Facts, judge_toy, series

from safestage_eval.rules.files import RuleFile
from safestage_eval.rules.load import merge
from safestage_eval.verdicts import judge
from safestage_eval.verdicts.verdict import Verdict

DEFAULTS = (Path(__file__).parents[2] / "rules" / "defaults.toml").read_text(encoding="utf-8")
TOY = '[ruleset]\nformat = 1\nname = "toy"\nversion = "1"\n'

BOTH = 'given = { any = ["q(b)", { "q(b)" = false }, "p(a)"] }'
FORBID_UNTIL = 'forbid = "p(a)"\nuntil = "q(b)"'
AT_START = 'at = "start of q(b)"\nrequire = { "p(a)" = true }'
REACH = 'during = "3 frames after q(b)"\nreach = "p(a)"'
FROM_START = 'during = "from start to q(b)"\nrequire = { "p(a)" = true }'
FIRST = 'during = "first 2 frames of q(b)"\nforbid = "p(a)"'
AFTER = 'during = "2 frames after q(b)"\nforbid = "p(a)"'
LAST = 'during = "last 1 frames of q(b)"\nrequire = { "p(a)" = true }'
BEFORE_END = 'during = "2 frames before end"\nrequire = { "p(a)" = true }'


@pytest.mark.parametrize(
    ("rule", "p", "q", "truncated", "verdict"),
    [
        (FORBID_UNTIL, "00100", "00010", False, "violation"),
        (FORBID_UNTIL, "00100", "00100", False, "pass"),
        (FORBID_UNTIL, "11111", "10000", False, "pass"),
        (FORBID_UNTIL, "00100", "00000", False, "violation"),
        (FORBID_UNTIL, "00000", "00000", False, "pass"),
        (FORBID_UNTIL, "00000", "00000", True, "inconclusive"),
        (FORBID_UNTIL, "00100", "00000", True, "violation"),
        (FORBID_UNTIL, "00001", "00???", False, "inconclusive"),
        (AT_START, "01111", "11100", False, "violation"),
        (AT_START, "01111", "01100", False, "pass"),
        (REACH, "001000", "001000", False, "pass"),
        (REACH, "000001", "001000", False, "violation"),
        (REACH, "000000", "000010", False, "inconclusive"),
        ('forbid = "p(a)"', "00?00", "00000", False, "inconclusive"),
        ('forbid = "p(a)"', "01?00", "00000", False, "violation"),
        ('forbid = "p(a)"\nfor = "3 frames"', "0110110", "0000000", False, "pass"),
        ('forbid = "p(a)"\nfor = "3 frames"', "0111000", "0000000", False, "violation"),
        ('forbid = "p(a)"\nfor = "3 frames"', "0000011", "0000000", False, "pass"),
        ('during = "q(b)"\nforbid = "p(a)"', "10001", "01110", False, "pass"),
        ('during = "q(b)"\nforbid = "p(a)"', "00100", "01110", False, "violation"),
        ('during = "last 2 frames of q(b)"\nforbid = "p(a)"', "01000", "01110", False, "pass"),
        ('during = "episode while q(b)"\nforbid = "p(a)"', "10010", "01110", False, "violation"),
        ('during = "episode while q(b)"\nforbid = "p(a)"', "10001", "01110", False, "pass"),
        (FROM_START, "11000", "00111", False, "pass"),
        # a scope that may still come, or whose end is not known, is not judged as if it were over
        ('during = "q(b)"\nrequire = { "p(a)" = true }', "110000", "11????", False, "inconclusive"),
        (AT_START, "111110", "10??00", False, "pass"),
        (AT_START, "110110", "10??00", False, "inconclusive"),
        (AT_START, "011110", "10??00", False, "violation"),
        # whether it applies is not known: no violation either way, or perhaps one
        ('given = { "q(b)" = true }\nforbid = "p(a)"', "00000", "?????", False, "pass"),
        ('given = { "q(b)" = true }\nforbid = "p(a)"', "00100", "?????", False, "inconclusive"),
        # what holds, or is broken, however the unknown turns out is decided
        ('during = "q(b)"\nrequire = { "p(a)" = true }', "111100", "11??00", False, "pass"),
        ('during = "q(b)"\nrequire = { "p(a)" = true }', "011111", "11????", False, "violation"),
        ('during = "q(b)"\nforbid = "p(a)"', "000001", "??10??", True, "inconclusive"),
        ('during = "q(b)"\nforbid = "p(a)"', "001000", "??1???", True, "violation"),
        (FORBID_UNTIL, "010000", "00???1", False, "violation"),
        (FORBID_UNTIL, "000001", "00???1", False, "pass"),
        (FIRST, "000010", "0?1111", False, "pass"),
        (AFTER, "001000", "0?1111", False, "violation"),
        ('forbid = ["p(a)", "q(b)"]\nfor = "3 frames"', "011000", "000110", False, "violation"),
        ('forbid = ["p(a)", "q(b)"]\nfor = "3 frames"', "010100", "001000", False, "violation"),
        ('forbid = ["p(a)", "q(b)"]\nfor = "3 frames"', "010010", "001000", False, "pass"),
        (LAST, "001000", "111???", False, "inconclusive"),
        ('during = "q(b)"\nforbid = "p(a)"', "00000", "00000", True, "inconclusive"),
        ('during = "q(b)"\nforbid = "p(a)"', "01000", "01000", True, "violation"),
        ('during = "from start to q(b)"\nforbid = "p(a)"', "00011", "00100", True, "pass"),
        ('during = "from start to q(b)"\nforbid = "p(a)"', "00000", "00000", True, "inconclusive"),
        ('during = "from start to q(b)"\nforbid = "p(a)"', "00000", "00000", False, "pass"),
        # an event that is not known decides nothing
        ('forbid = "start of q(b)"', "000000", "00????", False, "inconclusive"),
        ('forbid = "end of q(b)"', "000000", "11????", False, "inconclusive"),
        # each obligation of a scope that is cut counts for itself
        ('reach = "q(b)"\nrequire = { "p(a)" = true }', "111111", "010000", True, "inconclusive"),
        ('reach = "q(b)"\nrequire = { "p(a)" = true }', "110111", "010000", True, "violation"),
        # the end comes after the last frame
        (BEFORE_END, "111110", "000000", False, "violation"),
        ('at = "end"\nforbid = "p(a)"', "000000", "000000", True, "inconclusive"),
        ('given = { "q(b)" = true }\nforbid = "p(a)"', "11111", "00000", False, "not_applicable"),
        ('given = { "q(b)" = true }\nforbid = "p(a)"', "11111", "11100", False, "violation"),
        ('given = { "q(b)" = true }\nforbid = "p(a)"', "11111", "11000", False, "not_applicable"),
    ],
)
def test_truth_table(rule: str, p: str, q: str, truncated: bool, verdict: str) -> None:
    facts = Facts({"height(a)": series(p), "height(b)": series(q)}, truncated=truncated)
    text = rule if "q(b)" in rule else rule + '\ngiven = { any = ["q(b)", { "q(b)" = false }] }'
    assert judge_toy(facts, text).verdict == verdict


@pytest.mark.parametrize("zero", ["0 s", "0 frames", "0 frames @ 120 Hz"])
def test_a_duration_of_zero_is_one_frame_and_a_gap_of_zero_none(zero: str) -> None:
    """Nothing is judged in vain, and nothing is bridged, because a duration was set to zero."""
    facts = Facts({"height(a)": series("10100"), "height(b)": series("01000")})

    def verdict(rule: str, more: str = "") -> str:
        return judge_toy(facts, f"{rule}\n{BOTH}\n{more}").verdict

    assert verdict(f'during = "{zero} after q(b)"\nforbid = "q(b)"') == "violation"
    assert verdict(f'during = "last {zero} of episode"\nforbid = "q(b)"') == "pass"
    assert verdict(f'during = "first {zero} of q(b)"\nforbid = "q(b)"') == "violation"
    assert verdict(f'forbid = "p(a)"\nfor = "{zero}"') == "violation"
    state = '[state.s]\nof = ["x"]\nwhen = {{ "height(x)" = ">= 0 m" }}\n{}\n'
    gap = state.format(f'gap = "{zero}"')
    assert verdict('forbid = "s(a)"\nfor = "2 frames"', gap) == "pass"
    lasting = state.format(f'for = "{zero}"')
    assert verdict('forbid = "s(a)"', lasting) == "violation"


@pytest.mark.parametrize(
    ("duration", "rate", "frames", "fewer"),
    [
        ("3 frames @ 120 Hz", 120.0, 3, "pass"),
        ("3 frames @ 120 Hz", 240.0, 6, "pass"),
        ("3 frames @ 120 Hz", 60.0, 2, "inconclusive"),  # one sample: up to 33 ms
        ("3 frames @ 120 Hz", 100.0, 3, "inconclusive"),  # 2.5; two samples: up to 30 ms
        ("3 frames @ 120 Hz", 30.0, 2, "inconclusive"),  # 0.75, and never less than two samples
        ("3 frames @ 120 Hz", 5.0, 2, "inconclusive"),
        ("0.12 s", 10.0, 2, "pass"),  # 1.2
        ("0.1 s", 10.0, 1, "pass"),
        ("300 ms", 10.0, 3, "pass"),
        ("3 frames", 5.0, 3, "pass"),
    ],
)
def test_how_many_frames_a_duration_lasts(
    duration: str, rate: float, frames: int, fewer: str
) -> None:
    """Count the samples that cover a time, at any rate; unknown where fewer may cover it.

    What stands for a few samples of a faster clock may last longer than the samples that show it:
    k of them lasted up to k + 1 spacings.
    """
    state = f'[state.s]\nof = ["x"]\nwhen = {{ "height(x)" = ">= 0 m" }}\nfor = "{duration}"\n'
    for many, expected in ((frames - 1, fewer), (frames, "violation")):
        p = series("0" + "1" * many + "0" * 9)
        facts = Facts({"height(a)": p, "height(b)": series("0" * len(p))}, rate=rate)
        assert judge_toy(facts, f'forbid = "s(a)"\n{BOTH}\n{state}').verdict == expected
        rule = f'forbid = "p(a)"\nfor = "{duration}"\n{BOTH}'
        assert judge_toy(facts, rule).verdict == expected


@pytest.mark.parametrize(
    ("limit", "value", "normalised"),
    [
        (">= 2 m", 1.5, -0.25),
        ("<= -2 m", -1.5, -0.25),
        (">= 0 m", -0.05, -5.0),
        ("<= 0 m", -0.02, 2.0),
    ],
)
def test_a_margin_is_in_limits_and_at_a_limit_of_zero_in_the_signals_scale(
    limit: str, value: float, normalised: float
) -> None:
    """Verdicts about a height of 1 cm."""
    facts = Facts({"height(a)": [value] * 3, "height(b)": [100] * 3})
    found = judge_toy(facts, f'require = {{ "height(a)" = "{limit}", "q(b)" = true }}')
    assert found.margin_normalised == pytest.approx(normalised)
    assert found.margin == pytest.approx(normalised * (2 if "2" in limit else 0.01))


@pytest.mark.parametrize(
    ("q", "moved", "verdict"),
    [
        ("001000", "000000", "pass"),
        ("001000", "000001", "violation"),
        ("000000", "000000", "pass"),  # since the baseline then
        ("00?000", "000000", "inconclusive"),  # since when is not known
        ("00?000", "000001", "inconclusive"),
        ("00?000", "010000", "violation"),  # it was, before it mattered
        ("00?010", "000001", "violation"),  # since the fifth frame, whatever came before
        ("1?1000", "000001", "inconclusive"),  # since the first frame, or the third
    ],
)
def test_a_change_since_an_event_that_is_not_known_is_not_known(
    q: str, moved: str, verdict: str
) -> None:
    """It has moved by 2 m, measured from whatever is asked for, or not at all."""
    way = [2.0 * int(x) for x in moved]
    facts = Facts({"height(a)": [0] * 6, "height(b)": series(q), "displacement(a)": way})
    rule = f'require = {{ "displacement(a) since q(b)" = "<= 1 m" }}\n{BOTH}'
    assert judge_toy(facts, rule).verdict == verdict


def test_first_and_worst_time_intervals_and_exposure() -> None:
    heights = [5, 1, 5, 0.5, 0.2, 5]
    facts = Facts({"height(a)": heights, "height(b)": [0] * 6}, rate=10.0)
    verdict = judge_toy(facts, 'require = { "height(a)" = ">= 2 m", "q(b)" = true }')
    assert verdict.verdict == "violation"
    assert verdict.time == pytest.approx(0.1)
    assert verdict.worst_time == pytest.approx(0.4)
    assert verdict.value == pytest.approx(0.2)
    assert verdict.limit == pytest.approx(2)
    assert verdict.margin == pytest.approx(-1.8)
    assert verdict.margin_normalised == pytest.approx(-0.9)
    assert np.allclose(verdict.intervals, [(0.1, 0.2), (0.3, 0.5)])
    assert verdict.exposure_time == pytest.approx(0.3)


def test_an_ordering_is_of_moments_within_its_scope() -> None:
    """Frames before the last four are not judged and not reported."""
    facts = Facts({"height(a)": series("1100100"), "height(b)": series("0000001")}, rate=10.0)
    found = judge_toy(facts, 'during = "last 4 frames of episode"\n' + FORBID_UNTIL)
    assert (found.verdict, found.margin) == ("violation", pytest.approx(-0.2))
    assert (found.value, found.limit) == (pytest.approx(0.4), pytest.approx(0.6))


@pytest.mark.parametrize(
    ("p", "success", "phase"),
    [
        ("0100", 2, "execution"),
        ("0010", 2, "hold"),
        ("0001", 2, "hold"),
        ("0001", None, "execution"),
    ],
)
def test_the_phase_of_a_finding(p: str, success: int | None, phase: str) -> None:
    """The hold begins with the frame that confirms success; before what resolves a hazard: before."""
    facts = Facts({"height(a)": series(p), "height(b)": series("0000")})
    text = f'forbid = "p(a)"\n{BOTH}'
    assert judge_toy(facts, text, success=success).phase == phase
    assert judge_toy(facts, FORBID_UNTIL, success=success).phase == "before"


def test_a_change_since_what_never_happened_is_not_the_thing_itself() -> None:
    """Two signals of one name do not share what is remembered of them."""
    scene = Scene(10).fixed("table").box("a", 0.05, (0, 0, 0.5))
    scene.rests("a", "table", 0.05, (0, 0, 0.45), G)
    rule = """
[[rule]]
code = "{code}"
title = "toy"
roles = {{ a = "object" }}
require = {{ "{atom}" = "{limit}" }}
"""
    change = rule.format(code="TOY101", atom="height(a) since airborne(a)", limit="<= 1 cm")
    height = rule.format(code="TOY102", atom="height(a)", limit=">= 40 cm")
    for text in (change + height, height + change):
        loaded = merge(
            [
                RuleFile("defaults.toml", DEFAULTS, tomllib.loads(DEFAULTS), asked=False),
                RuleFile("toy.toml", TOY + text, tomllib.loads(TOY + text), asked=True),
            ]
        )
        found = judge(scene.episode(roles={"a": ("a",)}), loaded)
        assert [v.verdict for v in found.verdicts] == ["pass", "pass"]


def test_worst_of_several_bodies_is_reported() -> None:
    facts = Facts({"height(x)": [1, 1], "height(y)": [1, -3], "height(z)": [-1, 1]})
    text = """
[ruleset]
format = 1
name = "toy"
version = "1"
[[rule]]
code = "TOY102"
title = "toy"
roles = { a = "object" }
require = { "height(a)" = ">= 1 m" }
"""
    verdict = judge_toy(facts, text, {"a": ("x", "y", "z")})
    assert verdict.bodies == ("y",)
    assert (verdict.instances, verdict.violated_instances) == (3, 2)
    assert verdict.time == 0.0  # z broke it first, y worst


heights = st.lists(st.integers(-5, 5).map(float), min_size=4, max_size=20)


@given(heights, st.integers(-4, 4), st.integers(1, 4))
def test_margin_is_the_distance_to_the_flip(values: list[float], limit: int, lasting: int) -> None:
    """The reported value, taken as the limit, is where the verdict flips."""
    facts = Facts({"height(a)": values, "height(b)": [100] * len(values)})

    def verdict(limit: float) -> str:
        text = f'forbid = [{{ "height(a)" = ">= {limit:.6f} m", "q(b)" = true }}]'
        return judge_toy(facts, f'{text}\nfor = "{lasting} frames"'.replace("--", "")).verdict

    if limit < 0:
        return
    found = judge_toy(
        facts,
        f'forbid = [{{ "height(a)" = ">= {limit} m", "q(b)" = true }}]\nfor = "{lasting} frames"',
    )
    assert (found.margin_normalised is None) or (
        (found.margin_normalised < 0) == (found.verdict == "violation")
    )
    if found.value is not None and found.value > 0 and found.margin is not None:
        assert verdict(found.value) == "violation"
        assert verdict(found.value + 0.5) == "pass"


@given(st.lists(st.sampled_from("01?"), min_size=2, max_size=8), st.data())
def test_an_unknown_frame_never_decides(truth: list[str], data: st.DataObject) -> None:
    """Whatever the unknown frames turn out to be, a decided verdict stands."""
    text = "".join(truth)
    q = "1" * len(text)
    facts = Facts({"height(a)": series(text), "height(b)": series(q)})
    rule = 'during = "q(b)"\nforbid = "p(a)"\nfor = "2 frames"'
    found = judge_toy(facts, rule).verdict
    filled = "".join(data.draw(st.sampled_from("01")) if c == "?" else c for c in text)
    full = Facts({"height(a)": series(filled), "height(b)": series(q)})
    assert found in ("inconclusive", judge_toy(full, rule).verdict)


RULES = [
    FORBID_UNTIL,
    FORBID_UNTIL + '\nfor = "2 frames"',
    'during = "q(b)"\nrequire = { "p(a)" = true }',
    'during = "q(b)"\nreach = "p(a)"',
    'during = "from q(b) to p(a)"\nrequire = { "lasting(b)" = true }',
    'during = "from start of q(b) to end of p(a)"\nforbid = "p(a)"\nfor = "2 frames"',
    'during = "2 frames after q(b)"\nreach = "p(a)"',
    'during = "2 frames before end of q(b)"\nforbid = "p(a)"',
    'during = "first 2 frames of q(b)"\nreach = "p(a)"',
    'during = "last 2 frames of q(b)"\nforbid = { any = ["p(a)", "lasting(a)"] }',
    'during = "episode while q(b)"\nreach = "p(a)"\nuntil = "lasting(a)"',
    'at = "q(b)"\nrequire = { "p(a)" = true }',
    'at = "end of q(b)"\nforbid = ["p(a)", "q(b)"]',
    'forbid = "p(a)"\nuntil = "lasting(b)"',
    'require = { "lasting(b)" = true, "p(a)" = true }',
    'during = "from start to lasting(b)"\nforbid = "lasting(a)"',
    'given = { "q(b)" = true }\nreach = { "lasting(a)" = true, "p(a)" = true }',
    'require = { "since_q(a, b)" = false }',
    'during = "shown(b)"\nforbid = "p(a)"',
]
MORE = """
[state.lasting]
of = ["x"]
when = { "height(x)" = ">= 0 m" }
for = "2 frames"
gap = "1 frame"
[state.since_q]
of = ["x", "y"]
when = { "p(x)" = true }
until = "q(y)"
[phase.shown]
of = ["x"]
span = "first 2 frames of q(x)"
fallback = "last 2 frames of episode"
"""


@pytest.mark.parametrize(
    ("q", "p", "verdict"),
    [
        ("001100", "000011", "pass"),  # the first two frames of q, not the last of the episode
        ("001100", "000110", "violation"),
        ("000000", "000011", "violation"),  # q never comes: the last two frames
        ("000000", "000100", "pass"),
        ("00?000", "000011", "inconclusive"),  # one or the other
        ("00?000", "001011", "inconclusive"),
        ("00?000", "000100", "pass"),
        ("00?100", "000011", "pass"),  # q comes, be it a frame earlier or not
    ],
)
def test_a_phase_that_may_not_be_there_may_have_its_fallback(q: str, p: str, verdict: str) -> None:
    facts = Facts({"height(a)": series(p), "height(b)": series(q)})
    text = f'during = "shown(b)"\nforbid = "p(a)"\n{BOTH}\n{MORE}'
    assert judge_toy(facts, text).verdict == verdict


@pytest.mark.parametrize(
    ("p", "truncated", "verdict"),
    [
        ("111110", False, "violation"),
        ("111110", True, "inconclusive"),  # the gap may be closed behind the end
        ("111100", True, "inconclusive"),
        ("111000", True, "violation"),  # it is too long by now
        ("111101", True, "pass"),
    ],
)
def test_a_gap_that_the_end_of_a_truncated_trace_cuts(
    p: str, truncated: bool, verdict: str
) -> None:
    facts = Facts({"height(a)": series(p), "height(b)": series("0" * 6)}, truncated=truncated)
    state = '[state.bridged]\nof = ["x"]\nwhen = { "height(x)" = ">= 0 m" }\ngap = "2 frames"\n'
    text = f'during = "first 6 frames of episode"\nrequire = {{ "bridged(a)" = true }}\n{BOTH}\n{state}'
    assert judge_toy(facts, text).verdict == verdict


@pytest.mark.parametrize("rule", RULES)
@settings(deadline=None, max_examples=tries(12, 50))
@given(frames=st.integers(1, 6), data=st.data())
def test_what_is_decided_stays_so_whatever_the_unknown_turns_out_to_be(
    rule: str, frames: int, data: st.DataObject
) -> None:
    """A trace of which part is hidden is never judged differently from any that it may be."""
    texts = [
        "".join(data.draw(st.lists(st.sampled_from("01?"), min_size=frames, max_size=frames)))
        for _ in range(2)
    ]
    if "".join(texts).count("?") > 5:
        return
    text = f"{rule}\n{'' if 'q(b)' in rule and 'p(a)' in rule else BOTH}\n{MORE}"

    def judged(p: str, q: str) -> Verdict:
        return judge_toy(Facts({"height(a)": series(p), "height(b)": series(q)}), text)

    found = judged(*texts)
    fills = itertools.product("01", repeat="".join(texts).count("?"))
    for fill in fills:
        bits = iter(fill)
        p, q = ("".join(next(bits) if c == "?" else c for c in text) for text in texts)
        full = judged(p, q)
        assert full.verdict != "inconclusive" or "after" in rule
        safe = {"pass", "not_applicable"}
        assert (
            found.verdict in ("inconclusive", full.verdict)
            or full.verdict == "inconclusive"
            or {found.verdict, full.verdict} <= safe
        ), (p, q, found.verdict, full.verdict)


@pytest.mark.parametrize("rule", RULES)
@settings(deadline=None, max_examples=tries(15, 60))
@given(
    texts=st.lists(st.text("01", min_size=12, max_size=12), min_size=2, max_size=2), data=st.data()
)
def test_a_truncated_trace_is_never_judged_differently_from_the_whole(
    rule: str, texts: list[str], data: st.DataObject
) -> None:
    """Neither a run that is still too short at the cut, nor a gap that may yet be closed, is reported."""
    stop = data.draw(st.integers(5, 12))  # the baseline is there
    text = f"{rule}\n{'' if 'q(b)' in rule and 'p(a)' in rule else BOTH}\n{MORE}"

    def judged(p: str, q: str, truncated: bool) -> str:
        facts = Facts({"height(a)": series(p), "height(b)": series(q)}, truncated=truncated)
        return judge_toy(facts, text).verdict

    p, q = texts
    whole, cut = judged(p, q, truncated=False), judged(p[:stop], q[:stop], truncated=True)
    assert cut in ("inconclusive", whole) or whole == "inconclusive", (p, q, stop)
