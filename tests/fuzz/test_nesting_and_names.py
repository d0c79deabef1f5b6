"""Nesting without end, keys of many names, and files whose names are no text: told in words, or simply read."""

import os
import subprocess
import sys
from dataclasses import replace

import pytest
from click.testing import CliRunner
from import_targets import IMPORTS
from recordings import everything, falling_cube

from safestage_eval.cli import group
from safestage_eval.errors import InputError
from safestage_eval.formats import load, save
from safestage_eval.importers import import_all
from safestage_eval.report import render
from safestage_eval.rules import RuleErrors, load_bind, load_rules
from safestage_eval.run.score_traces import score_paths

DEEP = "[" * 100_000


@pytest.mark.parametrize("target", ["robolab", "maniskill", "lerobot"])
def test_files_beside_a_recording_nested_without_end(tmp_path, target):
    made = IMPORTS[target](tmp_path)
    for file in made.seed.rglob("*.json*"):
        whole = file.read_text()
        file.write_text(DEEP)
        try:
            failed = import_all(made.sources[0], tmp_path / f"to {file.name}", made.settings).failed
            assert all("nested too deep" in one.message for one in failed)
        except InputError as error:
            assert "nested too deep" in str(error) or "known format" in str(error)
        file.write_text(whole)


@pytest.mark.parametrize("ending", ["json", "jsonl", "csv"])
def test_results_nested_without_end(tmp_path, ending):
    path = tmp_path / f"rows.{ending}"
    cell = "episode_id,rule,verdict,intervals\nx,y,violation,{0}\n"
    path.write_text(cell.format(DEEP) if ending == "csv" else DEEP)
    for words in (["aggregate", path], ["compare", path, path], ["report", path, "-o", path]):
        done = CliRunner().invoke(group, list(map(str, words)))
        assert isinstance(done.exception, InputError | SystemExit), words


def test_expectations_nested_without_end(tmp_path):
    falling_cube("m").close(tmp_path / "m.mcap")
    (tmp_path / "golden.json").write_text(DEEP)
    words = ["score", str(tmp_path / "m.mcap"), "-r", "fsh", "--golden"]
    done = CliRunner().invoke(group, [*words, str(tmp_path / "golden.json")])
    assert "not a golden file" in str(done.exception)


@pytest.mark.parametrize("form", ["table", "json", "jsonl", "csv", "parquet", "markdown", "junit"])
def test_a_trace_and_a_folder_whose_names_are_no_text(tmp_path, form):
    folder = tmp_path / os.fsdecode(b"\xff folder")
    folder.mkdir()
    falling_cube("m", rules=("FSH101",)).close(folder / os.fsdecode(b"\xfe.mcap"))
    (folder / os.fsdecode(b"broken \xfd.mcap")).write_bytes(b"\x89MCAP0\r\n")
    scores = score_paths([folder], ["fsh"])
    assert [result.path.endswith("\\udcfe.mcap") for result in scores.results] == [True]
    assert [r"\udcfd" in problem.message for problem in scores.problems] == [True]
    outcome = render(scores, form)
    assert outcome if isinstance(outcome, bytes) else outcome.encode()


def test_a_dataset_in_a_folder_whose_name_is_no_text(tmp_path):
    one, other = (tmp_path / os.fsdecode(name) for name in (b"\xff", b"\xff\xfe"))
    ref = falling_cube("m").close(one)
    assert save(load(one), other).content_hash == ref.content_hash == load(other).content_hash
    sealed = tmp_path / os.fsdecode(b"\xffpacked")
    words = ["pack", str(one), "--out", str(sealed)]
    done = subprocess.run(
        [sys.executable, "-c", "from safestage_eval.cli import main; main()", *words],
        env={**os.environ, "PYTHONIOENCODING": "utf-8:strict"}, capture_output=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert rb"\udcffpacked" in done.stdout
    assert load(sealed).content_hash == ref.content_hash


def test_a_recording_in_a_folder_whose_name_is_no_text(tmp_path):
    for target in ("robolab", "lerobot"):
        made = IMPORTS[target](tmp_path / target)
        source = made.seed.rename(tmp_path / os.fsdecode(b"\xff" + target.encode()))
        [imported] = import_all(source, tmp_path / f"to {target}", made.settings).imported
        assert imported.source.startswith("\\udcff")


@pytest.mark.parametrize("name", ["x.\0", "x." + "y" * 300, "x.a\nb", "x. ", "x.toml"])
def test_attachments_with_endings_that_no_file_has(tmp_path, name):
    whole = everything()
    episode = replace(whole.episode(), attachments={name: b"content"})
    save(episode, tmp_path / "x.mcap")
    done = CliRunner().invoke(
        group, ["convert", str(tmp_path / "x.mcap"), "--to", "parquet", "-o", str(tmp_path / "ds")]
    )
    assert done.exit_code == 0, done.output
    assert dict(load(tmp_path / "ds").attachments) == {name: b"content"}


@pytest.mark.parametrize("of", ["a", '"a"', "a ", "'b.c'\t", "1"])
@pytest.mark.parametrize("form", ["{} = 1\n", "[{}]\n", "x = {{ {} = 1 }}\n"])
def test_keys_of_many_names(tmp_path, of, form):
    path = tmp_path / "x.toml"
    path.write_text(form.format(".".join([of] * 100_000)))  # a parser would take minutes
    with pytest.raises(RuleErrors, match="nested far too deeply"):
        load_rules([path])
    with pytest.raises(RuleErrors, match="nested far too deeply"):
        load_bind(path, load_rules(["ish"]))


@pytest.mark.parametrize("backwards", [False, True])
def test_states_that_rest_on_one_another_without_end(tmp_path, backwards):
    path = tmp_path / "x.toml"
    lines = [f'[state.s{i}]\nof = ["a"]\nwhen = {{ "s{i + 1}(a)" = true }}\n' for i in range(3000)]
    last = '[state.s3000]\nof = ["a"]\nwhen = { "height(a)" = "> 1 cm" }\n'
    head = '[ruleset]\nformat = 1\nname = "x"\nversion = "1.0.0"\n'
    path.write_text(head + "".join([last, *reversed(lines)] if backwards else [*lines, last]))
    with pytest.raises(RuleErrors, match="rests on 40 definitions"):
        load_rules([path])
