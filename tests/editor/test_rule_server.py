"""``safestage rules lsp`` as editors use it: a process that is spoken to in the protocol."""

import re

import pytest
from speaking import LanguageClient

from safestage_eval.cli import group
from safestage_eval.rules import check_rules

pytest.importorskip("pygls")

HEAD = """\
[ruleset]
format  = 1
name    = "mine"
version = "1.0.0"
extends = ["defaults"]

[param]
keep_off = "5 cm"        # from the hand
weight   = "3 N"
"""
RULE = """
[[rule]]
code    = "ETS901"
title   = "Carry nothing close to fragile things"
roles   = { target = "object", fragile = "every object tagged fragile" }
during  = "execution"
require = { "clearance(target, fragile)" = ">= keep_off" }
explain = "{target} came close to {fragile}: {value} at {t.worst}."
"""
SOUND = HEAD.replace('weight   = "3 N"\n', "") + RULE


@pytest.fixture(scope="module")
def client(tmp_path_factory):
    client = LanguageClient(tmp_path_factory.mktemp("rules"))
    yield client
    assert client.close() == 0


@pytest.fixture
def typing(client, tmp_path):
    """Opens a text in which « is the cursor; asks what may be written there, or what stands there."""

    def ask(marked, method="completion"):
        offset, text = marked.index("«"), marked.replace("«", "")
        client.open(tmp_path / "typed.toml", text)
        return client.at(method, text, offset), text, offset

    return ask


def chosen(answer, text, label):
    """The text after one of the offers was taken."""
    (item,) = [item for item in answer["items"] if item["label"] == label]
    edit = item["textEdit"]
    lines = text.split("\n")
    start, stop = edit["range"]["start"], edit["range"]["end"]
    assert start["line"] == stop["line"]
    line = lines[start["line"]]
    lines[start["line"]] = line[: start["character"]] + edit["newText"] + line[stop["character"] :]
    return "\n".join(lines)


def labels(answer):
    return [item["label"] for item in answer["items"]]


def rule_with(line):
    return HEAD + RULE.replace('require = { "clearance(target, fragile)" = ">= keep_off" }', line)


def test_a_sound_file_has_no_problems(client, tmp_path):
    assert client.open(tmp_path / "sound.toml", SOUND) == []


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ('">= keep_off"', '">= 20 N"'),
        ("clearance(target, fragile)", "clearence(target, fragile)"),
        ("clearance(target, fragile)", "clearance(target)"),
        ("format  = 1", "format  = 2"),
        ('"every object tagged fragile"', '"all fragile things"'),
        ("require", "requires"),
        ("{value}", "{valeu}"),
        ('["defaults"]', '["default"]'),
        ('"execution"', '"execution'),
        (RULE, RULE + "forbid = [\n"),
    ],
)
def test_diagnostics_are_those_of_the_checker(client, tmp_path, before, after):
    text = SOUND.replace(before, after)
    path = tmp_path / "wrong.toml"
    path.write_text(text, "utf-8")
    diagnostics = client.open(path, text)
    own = [one for one in check_rules([path]) if one.path.endswith("wrong.toml")]
    assert diagnostics
    assert [(d["code"], d["range"]["start"]["line"] + 1) for d in diagnostics] == [
        (one.code, one.line) for one in own
    ]
    for found, one in zip(diagnostics, own, strict=True):
        assert found["message"].split("\n")[0] == one.what
        length = len(text.split("\n")[one.line - 1])  # a range does not go beyond its line
        assert found["range"]["start"]["character"] == min(one.column - 1, length)
        assert found["range"]["end"]["character"] == min(one.column - 1 + one.length, length)


def test_columns_are_counted_in_utf_16(client, tmp_path):
    """A robot face is one character to the checker, and two units of the protocol."""
    line = 'examples = { passes = ["🤖🤖"], violated = [] }'
    text = SOUND + line
    (diagnostic,) = client.open(tmp_path / "faces.toml", text)
    at = line.index("violated") + 2
    assert diagnostic["code"] == "R201"
    assert diagnostic["range"]["start"]["character"] == at
    assert diagnostic["range"]["end"]["character"] == at + len("violated")
    client.change(text.replace("🤖🤖", "ab"))
    page = client.at("hover", text, text.index("examples"))
    assert page is not None


def test_what_is_wrong_in_an_extended_file_is_said_where_it_is_extended(client, tmp_path):
    (tmp_path / "base.toml").write_text(HEAD.replace('"5 cm"', '"5 parsec"'), "utf-8")
    text = SOUND.replace('["defaults"]', '["base.toml"]')
    diagnostics = client.open(tmp_path / "mine.toml", text)
    at = text.split("\n").index('extends = ["base.toml"]')
    assert any(
        d["range"]["start"]["line"] == at and "base.toml:8" in d["message"] for d in diagnostics
    )


def test_an_open_file_counts_as_it_is_typed_not_as_it_was_saved(client, tmp_path):
    path = tmp_path / "two.toml"
    path.write_text(SOUND, "utf-8")
    assert client.open(path, SOUND) == []
    assert client.change(SOUND.replace("keep_off", "keep_away", 1))
    assert client.change(SOUND) == []


def test_other_programs_toml_is_left_alone(client, tmp_path):
    assert client.open(tmp_path / "pyproject.toml", '[project]\nname = "x"\n') == []
    assert client.at("completion", "[project]\n", 10) is None
    assert client.at("hover", "[project]\n", 3) is None


@pytest.mark.parametrize(
    ("line", "offered", "not_offered"),
    [
        ("require = { «", ["clearance(target, fragile)", "contact(target, fragile)", "tilt(target)"], ["keep_off"]),
        ('require = { "clear«', ["clearance(target, fragile)", "supports(target, fragile)"], ["cm"]),
        ('require = { "clearance(target, «', ["target", "fragile", "robot", "gripper"], ["keep_off"]),
        ('require = { "clearance(target, fragile)" = ">= «', ["keep_off", "min_clearance"], ["weight", "still_for"]),
        ('require = { "clearance(target, fragile)" = ">= 5 «', ["m", "cm", "mm"], ["N", "deg"]),
        ('require = { "tilt(target)" = "<= 5 d«', ["deg", "rad"], ["cm"]),
        ('require = { "tilt(target)" = "<= «', ["max_tilt(target)", "toppled"], ["max_fall(target)", "edge"]),
        ('require = { "moved(target)" = «', ["true", "false"], ["keep_off"]),
        ('forbid = [\n  { "contact_force(target, fragile)" = ">= «', ["weight", "contact_force"], ["edge"]),
        ('forbid = ["«', ["success", "contact(target, fragile)"], ["clearance(target, fragile)"]),
        ('for = "«', ["still_for"], ["edge"]),
        ('for = "0.5 «', ["s", "ms", "frames"], ["cm"]),
        ("fo«", ["forbid", "for", "during"], ["base"]),
        ('set = { keep_off = "3 «', ["cm"], ["N"]),
        ("set = { «", ["keep_off", "min_clearance"], []),
        ('until = "start of «', ["contact(target, fragile)"], ["tilt(target)"]),
    ],
)  # fmt: skip
def test_completion_in_a_rule(typing, line, offered, not_offered):
    answer, *_ = typing(rule_with(line))
    found = labels(answer)
    assert set(offered) <= set(found)
    assert not set(not_offered) & set(found)


@pytest.mark.parametrize(
    ("marked", "offered"),
    [
        (HEAD + '\n[[rule]]\nroles = { target = "every object tagged «', ["fragile", "liquid"]),
        (HEAD + '\n[[rule]]\nroles = { a = "object", b = "every object except «', ["a"]),
        (HEAD + '\n[[rule]]\nroles = { target = "«', ["object", "every object", "gripper"]),
        (HEAD + "\n[[rule]]\nroles = { «", ["target", "protected"]),
        (HEAD.replace('["defaults"]', '["«'), ["defaults", "ets", "fsh"]),
        (HEAD + '\n[signal.calm]\nbase = "«', ["speed", "clearance"]),
        (HEAD + '\n[param]\nx = "3 «', ["cm", "deg", "N", "s"]),
        (HEAD + "\n[«", ["state", "phase", "ruleset"]),
        (HEAD + "\n[[rule]]\n[rule.«", ["rule.require", "rule.examples"]),
        (HEAD + '\n[state.x]\nof = ["a"]\nwhen = { "tilt(«', ["a"]),
        (HEAD + '\n[[rule]]\nroles = { cup = "object" }\nexplain = "the {«', ["cup", "value"]),
    ],
)
def test_completion_elsewhere(typing, marked, offered):
    answer, *_ = typing(marked)
    assert set(offered) <= set(labels(answer))


def test_nothing_is_offered_in_comments_and_free_text(typing):
    assert labels(typing(rule_with("# clear«"))[0]) == []
    assert labels(typing(rule_with('title = "Car«'))[0]) == []


def test_offers_that_are_taken_make_a_sound_rule(client, tmp_path, typing):
    """Each step as somebody types it, the last text checked."""
    text = rule_with("«").replace('weight   = "3 N"\n', "")
    steps = [
        ("req", "require", "{ "),
        ("", "clearance(target, fragile)", ""),
        ('">= ', "keep_off", '" }'),
    ]
    for typed, label, after in steps:
        answer, now, offset = typing(text.replace("«", typed + "«"))
        taken = chosen(answer, now, label)
        at = len(taken) - (len(now) - offset)
        text = taken[:at] + after + "«" + taken[at:]
    assert client.open(tmp_path / "whole.toml", text.replace("«", "")) == []


@pytest.mark.parametrize(
    "text",
    [SOUND, rule_with('forbid = [{ "contact(target, fragile)" = true, any = ["success"] }]')],
)
def test_no_prefix_of_a_file_ends_the_server(client, tmp_path, text):
    """Typed character by character, with completion and hover asked for all the while."""
    client.open(tmp_path / "grows.toml", "")
    for stop in range(1, len(text), 7):
        client.change(text[:stop])
        client.at("completion", text[:stop], stop)
        client.at("hover", text[:stop], max(0, stop - 2))
    assert client.process.poll() is None


@pytest.mark.parametrize("junk", ["\x00", "[" * 5000, "a." * 3000, "]]]}}}===", '"""', "x = 1e999999", "\ufeff", "[[rule]\n[rule", "[rule.x]\n[[rule]]"])  # fmt: skip
def test_junk_does_not_end_the_server(client, tmp_path, junk):
    text = HEAD + junk
    client.open(tmp_path / "junk.toml", text)
    client.at("completion", text, len(text))
    client.at("hover", text, len(text) - 1)
    assert client.process.poll() is None


@pytest.mark.parametrize(
    ("word", "said"),
    [
        ("clearance", ["clearance(a, b)", "needs", "geometry"]),
        ("keep_off", ["parameter", '"5 cm"', "from the hand", "typed.toml:8"]),
        ("execution", ["phase", "[phase.execution]", "defaults.toml:"]),
        ("fragile)", ["every object tagged fragile"]),
        ("during", ["frames that are judged"]),
        ("cm", ["length", "1 cm = 0.01 m"]),
    ],
)
def test_hover_shows_the_page_of_a_word(typing, word, said):
    text = HEAD + RULE
    at = (text.rindex if word == "keep_off" else text.index)(word)
    answer, *_ = typing(text[: at + 1] + "«" + text[at + 1 :], "hover")
    page = answer["contents"]["value"]
    assert [part for part in said if part not in page] == []
    lines, place = text.split("\n"), answer["range"]
    shown = lines[place["start"]["line"]][place["start"]["character"] : place["end"]["character"]]
    assert shown == word.rstrip(")")


def test_hover_of_every_signal_and_relation_is_its_page(client, tmp_path):
    from safestage_eval.report.rule_report import vocabulary

    names = [entry["name"] for entry in vocabulary()]
    text = HEAD + "\n[state.s]\nof = []\n[state.s.when]\n"
    rows = [f'"{name}(a)" = true' for name in names]
    text += "\n".join(rows)
    client.open(tmp_path / "all.toml", text)
    for entry, row in zip(vocabulary(), rows, strict=True):
        page = client.at("hover", text, text.index(f"\n{row}") + 3)["contents"]["value"]
        plain = re.sub(r"\s+", " ", page)
        assert re.sub(r"\s+", " ", entry["meaning"]) in plain
        assert all(need in page for need in entry["needs"])


def test_arguments_are_fields_where_the_editor_can_fill_them_in(tmp_path):
    item = {"snippetSupport": True}
    client = LanguageClient(tmp_path, textDocument={"completion": {"completionItem": item}})
    text = rule_with('require = { "clear')
    client.open(tmp_path / "x.toml", text)
    answer = client.at("completion", text, text.index('"clear') + 6)
    (taken,) = [i for i in answer["items"] if i["label"] == "clearance(target, fragile)"]
    assert taken["textEdit"]["newText"] == "clearance(${1:target}, ${2:fragile})"
    assert taken["insertTextFormat"] == 2
    assert client.close() == 0


def test_without_the_extra_it_says_how_to_get_it(monkeypatch):
    import sys

    from click.testing import CliRunner

    monkeypatch.setitem(sys.modules, "pygls", None)
    monkeypatch.setitem(sys.modules, "lsprotocol", None)
    monkeypatch.delitem(sys.modules, "safestage_eval.editor.rule_server", raising=False)
    result = CliRunner().invoke(group, ["rules", "lsp"])
    assert result.exit_code == 2
    assert 'pip install "safestage[lsp]"' in result.output
