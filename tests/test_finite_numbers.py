"""Wherever a number can be written: NaN, infinity and endless digits are refused, with place and remedy."""

import json

import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner
from recordings import falling_cube

from safestage_eval._text.json_text import from_json
from safestage_eval.cli import group
from safestage_eval.errors import InputError
from safestage_eval.formats import load, save
from safestage_eval.formats.mcap.mcap_metadata import from_texts
from safestage_eval.importers.map_file import load_map
from safestage_eval.rules import bind_tables, check_rules, load_bind, load_rules
from safestage_eval.rules.overrides import parse_overrides
from safestage_eval.sketch.load_sketch import read

DIGITS = {"309 digits": "9" * 309, "400 digits": "9" * 400, "5000 digits": "9" * 5000}
BARE = {"nan": "nan", "inf": "inf", "-inf": "-inf", "1e400": "1e400"} | DIGITS
JSON = {"nan": "NaN", "inf": "Infinity", "-inf": "-Infinity", "1e400": "1e400"} | DIGITS


def bind(path):
    return load_bind(path, load_rules(["fsh"]))


EXTENDS = '[ruleset]\nformat = 1\nname = "r"\nversion = "1"\nextends = ["ets.toml"]\n'
RULE = EXTENDS + (
    '[[rule]]\ncode = "ZZZ101"\ntitle = "t"\nroles = { a = "object" }\n'
    'forbid = { "tilt(a)" = ">= 20 deg" }\n'
)
SHARE = RULE.replace('"tilt(a)" = ">= 20 deg"', '"overlap_xy(a, b)" = ">= share"').replace(
    "}\nforbid", ', b = "object" }\nforbid'
)
COST = EXTENDS + (
    '[[cost]]\ncode = "ZZZ102"\ntitle = "t"\nroles = { a = "object" }\n'
    'charge = [{ of = "speed(a)", above = "2 cm/s", add = 1, per = "second" }]\nbudget = 4\n'
)

RULE_FILES = {
    "param": EXTENDS + "[param]\nshare = {}\n",
    "material": EXTENDS + "[material.default]\nshare = {}\n",
    "severity": SHARE + "severity = { serious = { share = {} } }\n[param]\nshare = 0.9\n",
    "rule's set": SHARE + "set = { share = {} }\n[param]\nshare = 0.9\n",
    "charge": COST.replace("add = 1", "add = {}"),
    "budget": COST.replace("budget = 4", "budget = {}"),
    "above": COST.replace('"2 cm/s"', "{}").replace("speed(a)", "overlap_xy(a, a)"),
    "operand": EXTENDS + '[signal.s]\nof = ["a", "b"]\nproduct = ["overlap_xy(a, b)", {}]\n',
    "format": RULE.replace("format = 1", "format = {}"),
}
"""Place → a rule file with a bare number there."""


def problems(text, tmp_path):
    """What is wrong with a rule file."""
    path = tmp_path / "r.toml"
    path.write_text(text)
    found = check_rules([path])
    if found:
        with pytest.raises(InputError, match="problem"):
            load_rules([path])
    return found


@pytest.mark.parametrize("place", RULE_FILES)
def test_a_bare_number_in_a_rule_file(place, tmp_path):
    """``share = nan`` passed with a margin of −∞ where 0.9 was a violation."""
    assert problems(RULE_FILES[place].replace("{}", "1"), tmp_path) == []
    for number in BARE.values():
        text = RULE_FILES[place].replace("{}", number)
        [problem] = problems(text, tmp_path)
        assert "not finite" in problem.what
        assert text.split("\n")[problem.line - 1][problem.column - 1 :].startswith(number)
        assert problem.allowed
        assert problem.fix
        assert len(problem.render()) < 1000


@pytest.mark.parametrize("text", [*BARE.values(), "-" + "9" * 400, "1e5"])
@pytest.mark.parametrize("unit", [" cm", ""])
def test_a_value_of_the_command_line(text, unit):
    with pytest.raises(InputError) as error:
        parse_overrides(load_rules(["fsh"]), {"edge": text + unit})
    assert error.value.allowed


@pytest.mark.parametrize(
    "number",
    [float("nan"), float("inf"), 10**400, 10**5000, "9" * 309 + " cm"],
    ids=["nan", "inf", "400", "5000", "text"],
)
def test_bindings_given_as_tables(number):
    table = {"task": {"t": {"set": {"edge": number}}}, "body": {"*": {"up": [0, 0, number]}}}
    with pytest.raises(InputError, match="2 problems"):
        bind_tables(table, load_rules(["fsh"]))


FILES = {
    "bind, set": (bind, '[task.t]\nset = { edge = {} }\n'),
    "bind, up": (bind, '[body."*"]\nup = [0, 0, {}]\n'),
    "map, dt": (load_map, "[source]\ndt = {}\n"),
    "map, mass": (load_map, "[body.a]\nmass = {}\n"),
    "map, position": (load_map, "[body.a]\nposition = [0, 0, {}]\n"),
    "map, size": (load_map, '[body.a]\nshapes = [{ kind = "sphere", size = [{}] }]\n'),
    "map, seed": (load_map, "[every]\nseed = {}\n"),
    "map, goal": (load_map, '[every.goal]\nx = [{}]\n'),
    "map, dt as text": (load_map, '[source]\ndt = "{} s"\n'),
    "map, position as text": (load_map, '[body.a]\nposition = [0, 0, "{} cm"]\n'),
    "sketch, friction": (read, 'duration = "1 s"\n[bodies.a]\nshape = "sphere 4 cm"\nfriction = {}\n'),
    "sketch, duration": (read, 'duration = "{} s"\n[bodies.a]\nshape = "sphere 4 cm"\n'),
    "sketch, shape": (read, 'duration = "1 s"\n[bodies.a]\nshape = "sphere {} m"\n'),
    "sketch, place": (read, 'duration = "1 s"\n[bodies.a]\nshape = "sphere 4 cm"\nat = "0, 0, {} cm"\n'),
    "sketch, sum": (read, 'duration = "1 s"\n[bodies.a]\nshape = "sphere 4 cm"\nat = "0, 0, 1 + {} cm"\n'),
    "sketch, knob": (read, 'duration = "{k} s"\nknobs = { k = {} }\n[bodies.a]\nshape = "sphere 4 cm"\n'),
}  # fmt: skip


@pytest.mark.parametrize("place", FILES)
def test_bind_files_map_files_and_sketches(place, tmp_path):
    read, text = FILES[place]
    path = tmp_path / "file.toml"
    for number in BARE.values():
        path.write_text(text.replace("{}", number))
        with pytest.raises(InputError) as error:
            read(path)
        assert "problem" in str(error.value)
        assert "file.toml:" in str(error.value)


HEADER = {
    "goal": '{"require": {"tilt(a)": [{}]}}',
    "joints": '[{"name": "j", "kind": "revolute", "limits": [0, {}]}]',
    "gravity": "[0, 0, {}]",
    "success_time": "{}",
    "seed": "{}",
}


@pytest.mark.parametrize("field", HEADER)
@pytest.mark.parametrize("number", JSON)
def test_headers_of_mcap(field, number):
    header = falling_cube().episode().header.model_dump_json()
    text = json.dumps(json.loads(header) | {field: "#"})
    texts = {
        "schema_version": "1.2",
        "header": text.replace('"#"', HEADER[field].replace("{}", JSON[number])),
    }
    with pytest.raises(InputError) as error:
        from_texts(texts, "a.mcap")
    assert "a.mcap, metadata header" in str(error.value)


@pytest.mark.parametrize("field", ["goal", "joints"])
@pytest.mark.parametrize("number", JSON)
def test_headers_of_datasets(field, number, tmp_path):
    ref = save(falling_cube().episode(), tmp_path / "dataset")
    table = pq.read_table(ref.path)
    text = HEADER[field].replace("{}", JSON[number])
    column = table.schema.get_field_index(field)
    pq.write_table(table.set_column(column, field, [[text]]), ref.path)
    with pytest.raises(InputError, match=f"column {field}"):
        load(ref.path)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf")])
@pytest.mark.parametrize("field", ["success_time", "horizon", "physics_dt"])
def test_numbers_of_datasets(field, value, tmp_path):
    ref = save(falling_cube().episode(), tmp_path / "dataset")
    table = pq.read_table(ref.path)
    column = table.schema.get_field_index(field)
    pq.write_table(table.set_column(column, field, [[value]]), ref.path)
    with pytest.raises(InputError, match=f"header field {field}.*not finite.* Allowed: .* Fix: "):
        load(ref.path)


@pytest.mark.parametrize("number", JSON)
def test_json_that_others_wrote(number):
    for text in (f"[{JSON[number]}]", f'{{"a": {JSON[number]}}}'.encode()):
        with pytest.raises(json.JSONDecodeError, match="not finite"):
            from_json(text)
    assert from_json('["NaN", 12345678901234567890, 1e300, -0.5e-400]') == [
        "NaN",
        12345678901234567890,
        1e300,
        0,
    ]


OPTIONS = [
    ["score", "x", "--timeout"], ["score", "x", "--jobs"], ["score", "x", "--sample", "1", "--sample-seed"],
    ["report", "tables", "x", "--random-seed"], ["sweep", "x", "--steps"],
    ["import", "x", "--timeout"], ["import", "x", "--limit"], ["import", "x", "--dt"], ["convert", "pack", "x", "--shard-episodes"],
    ["label", "x", "--seed"], ["score", "x", "--limits"], ["view", "x", "--port"],
]  # fmt: skip


@pytest.mark.parametrize("option", OPTIONS, ids=" ".join)
@pytest.mark.parametrize("number", BARE)
def test_options(option, number, tmp_path):
    text = f"frames={BARE[number]}" if option[-1] == "--limits" else BARE[number]
    to = ["--to", str(tmp_path / "o")] if option[0] == "import" else []
    done = CliRunner().invoke(group, [*option, text, *to])
    assert done.exit_code == 2, done.output
    assert option[-1] in done.output
