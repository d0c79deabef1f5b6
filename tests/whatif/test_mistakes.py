"""Each kind of mistake on small rules: which are made, which are distinguished, which are left out."""

import pytest

from safestage_eval.rules import load_rules
from safestage_eval.whatif.mutants import definitions, mutants, mutants_in

HEAD = """
[ruleset]
format  = 1
name    = "mine"
version = "1"
extends = ["defaults"]
"""


def made(tmp_path, rule, *kinds, deep=False, head=HEAD):
    """Names of the mistakes of some kinds in a rule, sorted."""
    file = tmp_path / "mine.toml"
    text = '[[rule]]\ncode = "FSH901"\ntitle = "Mine"\nexplain = "So."\n'
    file.write_text(head + text + rule)
    rules = load_rules([file])
    found = [*mutants(rules, rules.rules["FSH901"])]
    if deep:
        found += [m for name in definitions(rules) for m in mutants_in(rules, name)]
    return sorted(m.what for m in found if m.kind in kinds)


GIVEN = """
roles  = { target = "object", dependent = "object" }
given  = { "depends_on(dependent, target)" = true, "tilt(dependent)" = ">= tip" }
forbid = "dropped(dependent)"
"""


def test_given_is_left_out_part_by_part(tmp_path):
    scopes = made(tmp_path, GIVEN, "scope")
    assert scopes == [
        "without: only if depends_on(dependent, target)",
        "without: only if tilt(dependent) at least 10 deg (tip)",
    ]


def test_given_is_negated(tmp_path):
    said = "depends_on(dependent, target) → not depends_on(dependent, target)"
    assert said in made(tmp_path, GIVEN, "truth")


@pytest.mark.parametrize(
    ("until", "other"),
    [
        ("moved(target)", "until moved(target) → the end of moved(target)"),
        ("end of held(target)", "until the end of held(target) → the start of held(target)"),
    ],
)
def test_until_is_left_out_or_moved(tmp_path, until, other):
    rule = f'roles = {{ target = "object" }}\nforbid = "toppled(target)"\nuntil = "{until}"\n'
    said = other.split(" → ")[0]
    assert made(tmp_path, rule, "scope") == sorted([f"{said} → to the end", other])


def test_at_is_left_out_or_moved(tmp_path):
    rule = """
roles   = { target = "object" }
at      = "start of held(target)"
require = { "tilt(target)" = "<= tip" }
"""
    assert made(tmp_path, rule, "scope") == [
        "at the start of held(target) → always",
        "at the start of held(target) → the end of held(target)",
    ]


def test_since_is_left_out_or_moved(tmp_path):
    rule = """
roles   = { target = "object" }
require = { "turn(target) since end of held(target)" = "<= tip" }
"""
    assert made(tmp_path, rule, "scope") == [
        "since the end of held(target) → the start of held(target)",
        "turn(target) since the end of held(target) → since the start",
    ]


@pytest.mark.parametrize(
    ("span", "others"),
    [
        ("first 1 s of hold", {"the last 1 s of hold", "always"}),
        ("1 s after success", {"1 s before success", "always"}),
        ("episode while held(target)", {"the whole episode", "always"}),
        ("held(target)", {"always"}),
    ],
)
def test_spans_are_turned_round_or_left_out(tmp_path, span, others):
    rule = f"""
roles   = {{ target = "object" }}
during  = "{span}"
require = {{ "tilt(target)" = "<= tip" }}
"""
    found = {what.split(" → ")[1] for what in made(tmp_path, rule, "scope")}
    # without the state, "episode while held" is the whole episode, which is always
    assert found == others or found | {"always"} == others


def test_durations_are_twice_and_half_as_long_or_nothing(tmp_path):
    rule = """
roles  = { target = "object" }
forbid = { "tilt(target)" = ">= tip" }
for    = "0.5 s"
"""
    assert made(tmp_path, rule, "duration") == [
        "for 0.5 s → 0 s",
        "for 0.5 s → 0.25 s",
        "for 0.5 s → 1 s",
    ]


def test_a_duration_of_one_frame_is_made_no_shorter(tmp_path):
    rule = """
roles   = { target = "object" }
during  = "last 1 frame of episode"
require = { "tilt(target)" = "<= tip" }
"""
    assert made(tmp_path, rule, "duration") == ["duration 1 frame → 2 frames"]


def test_a_gap_of_one_frame_is_closed(tmp_path):
    head = (
        HEAD
        + """
[state.shaky]
of   = ["a"]
when = { "tilt(a)" = ">= tip" }
gap  = "1 frame"
"""
    )
    rule = 'roles = { target = "object" }\nforbid = "shaky(target)"\n'
    assert made(tmp_path, rule, "duration", deep=True, head=head) == [
        "gap 1 frame → 0 frames",
        "gap 1 frame → 2 frames",
    ]


def test_what_is_latched_or_falls_back_is_distinguished(tmp_path):
    head = (
        HEAD
        + """
[state.once]
of       = ["a"]
when     = { "speed(a)" = ">= moving" }
until    = "end"
fallback = { "displacement(a)" = ">= moved" }
"""
    )
    rule = 'roles = { target = "object" }\nforbid = "once(target)"\n'
    assert made(tmp_path, rule, "scope", deep=True, head=head) == [
        "no fallback", "not kept",
    ]  # fmt: skip


def test_a_variant_of_a_signal_is_mistaken_in_its_options(tmp_path):
    head = (
        HEAD
        + """
[signal.way]
base = "displacement"
norm = "max"
[signal.in_cell]
base = "workspace_margin"
box  = [["-1 m", "-1 m", "0 m"], ["1 m", "1 m", "2 m"]]
[signal.knock]
base = "impact"
over = "10 ms"
"""
    )
    rule = """
roles   = { target = "object" }
require = { "way(target)" = "<= 1 cm", "in_cell(target)" = ">= 0 m", "knock(target)" = "<= 5 N" }
"""
    found = made(tmp_path, rule, "unit", deep=True, head=head)
    assert [what for what in found if "(" not in what] == [
        "box → × 0.1", "box → × 10", "norm → l1", "norm → l2", "over → × 0.1", "over → × 10",
    ]  # fmt: skip


def test_more_bodies_play_a_role_than_should(tmp_path):
    rule = """
roles   = { target = "object", other = "every object tagged fragile except target" }
require = { "tilt(other)" = "<= max_tilt(other)" }
"""
    assert made(tmp_path, rule, "role") == [
        "max_tilt(other) → max_tilt(target)",
        "other = every object tagged fragile except target → every object except target",
        "other = every object tagged fragile except target → every object tagged fragile",
        "tilt(other) → tilt(target)",
    ]
