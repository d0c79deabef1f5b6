"""Every kind of problem is reported once, at its exact place; « » mark the place in the text."""

import ast as python_ast
import json
import re
from pathlib import Path

import pytest

from safestage_eval.errors import RuleError
from safestage_eval.rules import Diagnostic, RuleErrors, check_rules, load_rules
from safestage_eval.rules.string_parser import GONE_ATOMS
from safestage_eval.rules.table_keys import GONE

HEAD = '[ruleset]\nformat = 1\nname = "test"\nversion = "1"\nextends = ["defaults"]\n'
RULE = """
[[rule]]
code = "ETS901"
title = "a rule"
roles = { a = "object", b = "object" }
"""
GOOD = 'require = { "clearance(a, b)" = ">= 5 cm" }\n'


def rule(text: str) -> str:
    return HEAD + RULE + text


CASES = [
    ("R102", HEAD + "a = «»«", False),
    ("R103", '[ruleset]\nformat = «2»\nname = "x"\nversion = "1"\n'),
    ("R104", HEAD.replace('"defaults"', '«"default"»')),
    ("R106", rule(GOOD) + RULE.replace('"ETS901"', '«"ETS901"»') + GOOD),
    # structure
    ("R201", HEAD + "«[rules]»\n"),
    ("R201", rule(GOOD + "«exclude» = 3\n")),
    ("R201", HEAD + "[state.x]\nof = []\nwhen = { any = [\"success\"] }\n«duration» = \"1 s\"\n"),
    ("R202", HEAD + '«[state.x]»\nof = []\n'),
    ("R202", HEAD + '«[[rule]]»\ncode = "ETS901"\n' + GOOD.replace("(a, b)", "(robot, gripper)")),
    ("R202", HEAD + '«[[rule]]»\ncode = "ETS901"\ntitle = "asks for nothing"\n'),
    ("R203", rule("require = «true»\n").replace('roles = { a = "object", b = "object" }\n', "")),
    ("R203", rule(GOOD).replace('"ETS901"', '«"ets901"»')),
    ("R203", rule(GOOD + "examples = { passes = [«3»] }\n")),
    ("R203", rule('forbid = [{ any = «"touching(a, b)"» }, "contact(a, b)"]\n')),
    ("R204", rule('[rule.require]\n"clearance(a, b)" = ">= 5 cm"\n«until» = "success"\n')),
    ("R205", rule(GOOD + 'at = "success"\n«during» = "episode"\n')),
    ("R205", rule(GOOD + 'at = "success"\n«until» = "end"\n')),
    ("R206", rule('«forbid» = { "moved(a)" = true, "moved(b)" = true }\n')),
    (
        "R207",
        rule('require = { any = [{ any = [«{ "contact(a, b)" = true }»] }, "moved(a)"] }\n'),
    ),
    ("R208", rule(GOOD + '«for» = "1 s"\n')),
    ("R209", rule(GOOD + 'explain = «"{a} came near {c}"»\n')),
    ("R209", rule(GOOD + 'explain = «"{a} at {t.moved}"»\n')),
    ("R209", rule(GOOD + 'explain = «"{a"»\n')),
    (
        "R211",
        rule('require = { "clearance(a, b)" = ">= 5 cm", «"clearance(a,b)"» = "<= 1 m" }\n'),
    ),
    ("R210", HEAD + '«[state.success]»\nof = []\nwhen = { any = ["success"] }\n'),
    ("R210", HEAD + '«[state.inside]»\nof = ["a"]\nwhen = { "moved(a)" = true }\n'),
    ("R210", HEAD + '«[state.hold]»\nof = ["a"]\nwhen = { "moved(a)" = true }\n'),
    ("R210", HEAD + '[state.x]\nof = [«"m"»]\nwhen = { "moved(m)" = true }\n'),
    ("R210", HEAD + '[state.x]\nof = ["a", «"a"»]\nwhen = { "contact(a, a)" = true }\n'),
    ("R210", HEAD + '[param]\n«"Edge"» = "2 cm"\n'),
    # strings
    ("R301", rule('require = { "clearance(a, b)" = «"5 cm"» }\n')),
    ("R301", rule('require = { "clearance(a, b)" = [">= 1 cm", «"≤ 5 cm"»] }\n'), False),
    ("R302", HEAD + '[state.x]\nof = ["a"]\nwhen = { "moved(a)" = true }\nfor = «"3 frames @ Hz"»\n'),
    ("R302", HEAD + '[state.x]\nof = ["a"]\nwhen = { "moved(a)" = true }\ngap = «"1.5 frames"»\n'),
    ("R303", rule(GOOD + 'until = «"once moved(a)"»\n')),
    ("R304", rule(GOOD + 'during = «"the last second"»\n')),
    ("R304", HEAD + '[baseline]\nspan = «"last 1 s of episode"»\n'),
    ("R305", rule(GOOD).replace('a = "object"', 'a = «"any object"»')),
    ("R306", HEAD + '[param]\nsize = «"5 parsecs"»\n'),
    ("R306", HEAD + "[param]\nsize = «true»\n"),
    ("R307", rule('require = { «"clearance a b"» = ">= 5 cm", "contact(a, b)" = false }\n')),
    # names
    ("R401", rule('require = { "«clearence»(a, b)" = ">= 5 cm" }\n')),
    ("R401", rule(GOOD + 'during = "«holding»"\n')),
    ("R401", HEAD + '[signal.x]\nbase = «"distance"»\n'),
    ("R402", rule('require = { «"moved(a, b)"» = false }\n')),
    ("R402", rule(GOOD + 'during = «"settle"»\n')),
    ("R403", rule('require = { "clearance(a, «c»)" = ">= 5 cm", "moved(b)" = false }\n')),
    ("R403", rule('require = { "contact(a, b)" = «"at least 2 c"» }\n')),
    ("R403", rule(GOOD).replace('b = "object"', 'b = «"object except c"»')),
    ("R404", rule(GOOD + 'until = "«speed»(a)"\n')),
    ("R404", rule('forbid = [{ "«hold»(a)" = true }, "contact(a, b)"]\n')),
    ("R405", rule('require = { "clearance(a, b)" = «true» }\n')),
    ("R405", rule('require = { "contact(a, b)" = «"<= 5 N"» }\n')),
    ("R405", HEAD + '[state.x]\nof = ["a"]\nwhen = { "moved(a)" = «"at least 2 a"» }\n'),
    ("R406", rule('require = { «"clearance(a, b) since success"» = ">= 5 cm" }\n')),
    ("R407", rule('require = { "clearance(a, b)" = «">= 5 deg"» }\n')),
    ("R407", rule('require = { "clearance(a, b)" = «">= 5"» }\n')),
    ("R407", rule('require = { "clearance(a, b)" = «">= hold_time"» }\n')),
    ("R407", rule(GOOD + 'during = «"drop_height after success"»\n')),
    ("R407", rule(GOOD.replace(" }", ', "moved(a)" = false }') + 'set = { moved = «"3 s"» }\n')),
    ("R407", HEAD + '[material.default]\nx = "1 cm"\n[material.y]\nx = «"1 N"»\n'),
    ("R408", rule('require = { "clearance(a, b)" = ">= «clearance»" }\n')),
    ("R408", rule(GOOD + 'set = { «mooved» = "1 cm" }\n')),
    ("R409", rule('require = { "tilt(a)" = "<= «max_lean»(a)", "contact(a, b)" = false }\n')),
    ("R409", HEAD + '[material.y]\n«x» = "1 cm"\n'),
    ("R410", HEAD + '«[state.x]»\nof = ["a"]\nwhen = { "y(a)" = true }\n'
             '[state.y]\nof = ["a"]\nwhen = { "x(a)" = true }\n'),
    ("R411", rule('require = { "moved(a)" = false }\n').replace('b = "object"', '«b» = "object"')),
    ("R411", HEAD + '[state.x]\nof = ["a", «"b"»]\nwhen = { "moved(a)" = true }\n'),
    ("R412", rule(GOOD) + '[param]\n«size» = "1 cm"\n'),
    ("R412", rule(GOOD) + '«[state.x]»\nof = ["a"]\nwhen = { "moved(a)" = true }\n'),
    ("R412", rule(GOOD + 'severity = { bad = { «moved» = "1 cm" } }\n')),
    ("R413", rule(GOOD.replace(" }", ', "tilt(«robot»)" = "<= 5 deg" }'))),
    ("R413", rule(GOOD.replace(" }", ', «"moved(robot)"» = false }'))),
    # options of signals
    ("R414", HEAD + '[signal.x]\nbase = "joint_speed"\n«over» = "50 ms"\n'),
    ("R414", HEAD + '[signal.x]\nbase = "impact"\nover = «"3 frames"»\n'),
    ("R414", HEAD + '[signal.x]\nbase = "impact"\nover = «"contact_for"»\n'),
    ("R414", HEAD + '[signal.x]\nbase = "joint_speed"\nunit = «"N"»\n'),
    ("R414", HEAD + '[signal.x]\nbase = "channel"\nchannel = "heat"\nunit = «"F"»\n'),
    ("R414", HEAD + '[signal.x]\nbase = "displacement"\nnorm = «"l3"»\n'),
    ("R414", HEAD + '«[signal.x]»\nbase = "workspace_margin"\n'),
    ("R414", HEAD + '«[signal.x]»\nbase = "channel"\nunit = "degC"\n'),
    ("R414", HEAD + '[signal.x]\nbase = "workspace_margin"\nbox = «[["0 m", "0 m", "0 m"]]»\n'),
    ("R414", HEAD + '[signal.x]\nbase = "workspace_margin"\n'
             'box = «[["0 m", "0 m", "0 m"], ["1 m", "1 m", "0 cm"]]»\n'),
    ("R414", HEAD + '[signal.x]\nbase = "workspace_margin"\n'
             'box = [["0 m", "0 m", "0 m"], ["1 m", "1 m", «"9 deg"»]]\n'),
    ("R414", rule(GOOD.replace(" }", ', «"workspace_margin(a)"» = ">= 0 cm" }'))),
    ("R407", HEAD + '[signal.heat]\nbase = "channel"\nchannel = "temperature"\nunit = "degC"\n'
             + RULE + GOOD.replace(" }", ', "heat(a)" = «"<= 80 %"» }')),
    ("R407", HEAD + '[signal.slide]\nbase = "joint_speed"\nunit = "m/s"\n'
             + RULE + GOOD.replace(" }", ', "slide(a)" = «"<= 1 rad/s"» }')),
    ("R407", rule(GOOD.replace(" }", ', "channel(flag, a)" = «">= 1 N"» }'))),
    ("R409", rule(GOOD.replace(" }", ', «"impact(a)"» = "<= 5 N", «"health(a)"» = ">= 90 %" }')
                  .replace('«"impact(a)"»', '"impact(a)"'))
             + '[material.default]\ndamage_scale = 1\nimpact_sensitivity = 1\n'
             'hold_sensitivity = 1\n'),
    ("R407", rule(GOOD.replace(" }", ', «"health(a)"» = ">= 90 %" }'))
             + '[material.default]\ndamage_scale = 1\nimpact_sensitivity = 1\n'
             'hold_sensitivity = 1\ndamage_threshold = "1 m"\n'),
    ("R413", HEAD + '[signal.calm]\nbase = "speed"\n[state.fine]\nof = ["x"]\n'
             'when = { "calm(x)" = "<= 1 m/s" }\n' + RULE
             + GOOD.replace(" }", ', «"fine(robot)"» = true }')),
    ("R415", rule(GOOD + 'until = "moved(j)"\n').replace('b = "object"', 'b = "object", j = "joint"')
             .replace('"moved(j)"', '«"moved(j)"»')),
    ("R415", rule(GOOD.replace(" }", ', «"speed(j)"» = "<= 1 m/s" }'))
             .replace('b = "object"', 'b = "object", j = "every joint tagged revolute"')),
    ("R416", rule(GOOD.replace(" }", ', "far(a)" = "<= 1 m" }'))
             + '[signal.far]\nof = ["x"]\nproduct = «["height(x)"]»\n'),
    ("R416", rule(GOOD.replace(" }", ', "far(a)" = "<= 1 m" }'))
             + '[signal.far]\nof = ["x"]\nproduct = ["height(x)", «true»]\n'),
    ("R407", rule(GOOD.replace(" }", ', "far(a)" = "<= 1 m" }'))
             + '[signal.far]\nof = ["x"]\ndifference = «["height(x)", "1 N"]»\n'),
    ("R407", rule(GOOD.replace(" }", ', "soon(a)" = «"<= 1 m"» }'))
             + '[signal.soon]\nof = ["x"]\nderivative = "height(x)"\n'),
    ("R305", rule(GOOD).replace('a = "object"', 'a = «"every object unnamed"»')),
]  # fmt: skip


def unmark(text: str) -> tuple[str, int, int, int]:
    """The text without marks; line, column and length of what they enclose."""
    first = text.index("«")
    stop = text.index("»") - 1
    line = text.count("\n", 0, first) + 1
    column = first - text.rfind("\n", 0, first)
    return text.replace("«", "").replace("»", ""), line, column, stop - first


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case[0]}")
def test_the_place_is_exact(case: tuple[str, ...], tmp_path: Path) -> None:
    code, marked = case[:2]
    text, line, column, length = unmark(marked)
    (tmp_path / "mine.toml").write_text(text, "utf-8")
    found = check_rules([tmp_path / "mine.toml"])
    assert [(d.code, d.line, d.column) for d in found] == [(code, line, column)], found
    if len(case) == 2:
        assert found[0].length == length
        assert found[0].source == text.split("\n")[line - 1]


def test_not_utf8(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_bytes(HEAD.encode() + b'x = "\xff"')
    assert [d.code for d in check_rules([tmp_path])] == ["R101"]


def test_circular_extension(tmp_path: Path) -> None:
    for name, base in (("a", "b"), ("b", "a")):
        (tmp_path / f"{name}.toml").write_text(HEAD.replace("defaults", f"{base}.toml"))
    found = check_rules([tmp_path / "a.toml"])
    assert [d.code for d in found] == ["R104"]
    assert "a.toml → b.toml → a.toml" in found[0].what


def test_unrelated_files_must_not_mean_two_things(tmp_path: Path) -> None:
    for name, value in (("a", "1 cm"), ("b", "2 cm")):
        (tmp_path / f"{name}.toml").write_text(HEAD + f'[param]\nsize = "{value}"\n')
    (found,) = check_rules([tmp_path])
    assert (found.code, found.line) == ("R105", 7)
    assert found.path.endswith("b.toml")
    assert str(tmp_path / "a.toml") in found.what
    extending = HEAD.replace("defaults", "a.toml") + '[param]\nsize = "2 cm"\n'
    (tmp_path / "b.toml").write_text(extending)
    assert check_rules([tmp_path]) == []
    assert load_rules([tmp_path]).params["size"].text == "2 cm"


@pytest.mark.parametrize("gone", [*GONE, *GONE_ATOMS])
def test_what_the_language_had_is_refused_with_what_says_it_now(gone: str, tmp_path: Path) -> None:
    written = {
        "family": "[family.x]\n", "task": "[task.x]\n",
        "charge.whole": '[[cost]]\ncode = "ETS902"\ntitle = "t"\ncharge = [{ of = "clearance(robot, gripper)", '
                        'add = 1, per = "step", whole = true }]\n',
        r"^once\b": '"once moved(a)" = true', r"^always\b": '"always[0 s, 1 s] moved(a)" = true',
        r" since\[": '"moved(a) since[0 s] moved(b)" = true', r"\) iff ": '"moved(a) iff moved(b)" = true',
        r"\) xor ": '"moved(a) xor moved(b)" = true',
    }.get(gone, f'[signal.x]\nof = ["a"]\n{gone.removeprefix("signal.")} = ["height(a)", "1 m"]\n')  # fmt: skip
    text = rule(f'require = {{ "clearance(a, b)" = ">= 1 cm", {written} }}\n') if gone in GONE_ATOMS else HEAD + written  # fmt: skip
    (tmp_path / "mine.toml").write_text(text)
    (found,) = [one for one in check_rules([tmp_path / "mine.toml"]) if "any more" in one.what]
    assert {**GONE, **GONE_ATOMS}[gone] in (found.fix, found.allowed)


@pytest.mark.parametrize("backwards", [False, True])
@pytest.mark.parametrize(("deep", "codes"), [(30, []), (60, ["R410"]), (2000, ["R410"])])
def test_definitions_rest_on_one_another_only_so_deep(
    deep: int, codes: list[str], backwards: bool, tmp_path: Path
) -> None:
    on = ["height(a)", *(f"s{i}(a)" for i in range(deep - 1))]
    signals = [f'[signal.s{i}]\nof = ["a"]\nabs = "{one}"\n' for i, one in enumerate(on)]
    last = f'forbid = [{{ "s{deep - 1}(a)" = "> 1 m" }}, "contact(a, b)"]\n'
    text = HEAD + "".join(reversed(signals) if backwards else signals) + RULE + last
    (tmp_path / "mine.toml").write_text(text)
    assert [d.code for d in check_rules([tmp_path / "mine.toml"])] == codes


def test_all_problems_at_once(tmp_path: Path) -> None:
    texts = [
        'require = { "clearence(a, b)" = ">= 5 cm" }\nduring = "holding"\n',
        'forbid = { "tilt(a)" = ">= 15 cm", "speed(b) since success" = ">= 1 m/s" }\n',
    ]
    rules = [RULE.replace("901", f"90{i}") + text for i, text in enumerate(texts)]
    (tmp_path / "bad.toml").write_text(HEAD + "".join(rules))
    found = check_rules([tmp_path / "bad.toml"])
    assert [d.code for d in found] == ["R401", "R401", "R206", "R407", "R406"]
    with pytest.raises(RuleErrors) as caught:
        load_rules([tmp_path / "bad.toml"])
    assert caught.value.diagnostics == found
    assert isinstance(caught.value, RuleError)
    assert all(d.render() in str(caught.value) for d in found)
    assert "5 problems" in str(caught.value)


def test_rendered_like_a_compiler(tmp_path: Path) -> None:
    text = rule('require = { "clearence(a, b)" = ">= 5 cm" }\n')
    (tmp_path / "mine.toml").write_text(text)
    (found,) = check_rules([tmp_path / "mine.toml"])
    assert found.render().splitlines() == [
        "error[R401]: there is no signal or state called clearence()",
        f"  --> {tmp_path}/mine.toml:11:14",
        "   |",
        '11 | require = { "clearence(a, b)" = ">= 5 cm" }',
        "   |              ^^^^^^^^^",
        '   = fix: did you mean "clearance"?',
        "   = allowed: built-in signals and relations, and declared states (safestage rules signals)",
    ]
    assert Diagnostic(**json.loads(json.dumps(found.to_dict()))) == found


def test_a_misspelt_role_is_one_error_that_names_the_role(tmp_path: Path) -> None:
    text = rule('require = { "clearance(a, protcted)" = ">= 5 cm" }\n').replace(
        "b =", "protected ="
    )
    (tmp_path / "mine.toml").write_text(text)
    (found,) = check_rules([tmp_path / "mine.toml"])
    assert (found.code, found.fix) == ("R403", 'did you mean "protected"?')
    assert found.source[found.column - 1 :][: found.length] == "protcted"


def test_the_caret_keeps_tabs() -> None:
    shown = Diagnostic("x", 1, 3, "R201", "…", source="\t\tkey = 1", length=3).render()
    assert shown.splitlines()[-1] == "  | \t\t^^^"


def test_every_code_is_tested_and_explained() -> None:
    root = Path(__file__).parents[2]
    used = set()
    for path in (root / "safestage_eval" / "rules").glob("*.py"):
        for node in python_ast.walk(python_ast.parse(path.read_text("utf-8"))):
            if isinstance(node, python_ast.Constant) and re.fullmatch(r"R\d{3}", str(node.value)):
                used.add(node.value)
    explained = set(
        re.findall(r"^\| `(R\d{3})`", (root / "docs" / "rules.md").read_text("utf-8"), re.M)
    )
    tested = {case[0] for case in CASES} | {"R101", "R105"}
    assert used == tested == explained
