"""Rule files are found, read through what they extend, and merged."""

import pickle
import subprocess
import sys
from pathlib import Path

import pytest

from safestage_eval.errors import RuleError
from safestage_eval.rules import builtin_names, check_rules, files, load_rules, rule_digest
from safestage_eval.rules.syntax import Duration, Part, Quantity, Whole

HEAD = '[ruleset]\nformat = 1\nname = "{name}"\nversion = "2"\n'
RULE = '[[rule]]\ncode = "{code}"\ntitle = "t"\nroles = {{ a = "object" }}\nforbid = "moved(a)"\n'


def write(folder: Path, name: str, extends: list[str], rest: str = "") -> Path:
    path = folder / f"{name}.toml"
    path.write_text(HEAD.format(name=name) + f"extends = {extends}\n" + rest, "utf-8")
    return path


@pytest.mark.parametrize("name", builtin_names())
def test_builtin_files_check_clean(name: str) -> None:
    assert check_rules([name]) == []


def test_all_builtin_files_are_one_rule_set() -> None:
    rules = load_rules([files.builtin_folder()])
    assert {
        "ISH101",
        "ISH201",
        "ETS101",
        "ETS102",
        "ETS201",
        "ETS202",
        "FSH101",
        "FSH104",
        "FSH202",
    } <= set(rules.rules)
    assert {"on", "on_upright", "in"} <= set(rules.goals)
    assert rules.params["hold_time"] == Duration(5.0)
    assert rules.params["contact_for"] == Duration(0.025, least=2)
    assert rules.baseline == Part("first", Duration(5, frames=True), Whole())
    assert rules.materials["bottle"]["max_tilt"].text == "8 deg"


@pytest.mark.parametrize("name", builtin_names())
def test_every_parameter_of_a_builtin_file_says_whence(name: str) -> None:
    lines = (files.builtin_folder() / f"{name}.toml").read_text("utf-8").split("\n")
    inside = False
    for line in lines:
        inside = line == "[param]" or (inside and not line.startswith("["))
        assert not inside or "=" not in line.split("#")[0] or "#" in line, line


def test_rules_of_extended_files_are_not_judged(tmp_path: Path) -> None:
    mine = write(tmp_path, "mine", ["fsh.toml"], '[param]\nedge = "3 cm"\n')
    assert load_rules([mine]).rules == {}
    rules = load_rules(["fsh", mine])
    assert rules.rules.keys() == load_rules(["fsh"]).rules.keys()
    assert rules.params["edge"] == Quantity(0.03, "length")
    assert load_rules([mine, "fsh"]).params == rules.params
    assert rules.name == "fsh+mine"


def test_paths_are_relative_to_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "sub").mkdir()
    write(tmp_path, "base", ["defaults"], '[param]\nsize = "1 cm"\n')
    write(tmp_path / "sub", "mine", ["../base.toml"], RULE.format(code="ETS901"))
    monkeypatch.chdir(tmp_path)
    rules = load_rules(["sub"])
    assert rules.params["size"].text == "1 cm"
    assert (rules.rules["ETS901"].path, rules.rules["ETS901"].line) == ("sub/mine.toml", 6)


def test_material_rows_are_merged_by_column(tmp_path: Path) -> None:
    mine = write(tmp_path, "mine", ["fsh"], '[material.bottle]\nmax_tilt = "5 deg"\n'
                 '[material.mug]\nmax_tilt = "9 deg"\n')  # fmt: skip
    materials = load_rules([mine]).materials
    tilts = {name: row["max_tilt"].text for name, row in materials.items() if "max_tilt" in row}
    shipped = load_rules(["fsh"]).materials
    assert tilts == {
        **{name: row["max_tilt"].text for name, row in shipped.items() if "max_tilt" in row},
        "bottle": "5 deg", "mug": "9 deg",
    }  # fmt: skip
    assert materials["fruit"] == shipped["fruit"]


@pytest.mark.parametrize(
    ("spec", "words"), [("fhs", 'did you mean "fsh"?'), ("none.toml", "built-in name")]
)
def test_no_such_file(spec: str, words: str) -> None:
    with pytest.raises(RuleError, match="no such rule file") as caught:
        load_rules([spec])
    assert words in str(caught.value).replace("\\", "")


def test_reading_rules_needs_no_geometry() -> None:
    code = (
        "import sys; from safestage_eval.rules import load_rules; load_rules(['fsh']);"
        "heavy = {'scipy', 'polars', 'pandas', 'pyarrow', 'fcl', 'mujoco', 'trimesh'};"
        "sys.exit(', '.join(heavy & set(sys.modules)) or None)"
    )
    subprocess.run([sys.executable, "-c", code], check=True, cwd=Path(__file__).parents[2])


def test_nesting_beyond_reason_is_a_problem_of_the_file(tmp_path: Path) -> None:
    path = tmp_path / "deep.toml"
    path.write_text("x = " + "[" * 5000 + "]" * 5000, "utf-8")
    assert [d.code for d in check_rules([path])] == ["R102"]


def test_equal_rule_sets_hash_alike_and_survive_pickling() -> None:
    rules = load_rules(["ets"])
    rule = next(iter(rules.rules.values()))
    digest = rule_digest(rules, rule, rules.params)  # fills what is remembered by identity
    copy = pickle.loads(pickle.dumps(rules))
    assert copy == rules
    assert hash(copy) == hash(rules)
    assert copy.digest == rules.digest
    assert copy.known == {}
    assert rule_digest(copy, copy.rules[rule.code], copy.params) == digest
