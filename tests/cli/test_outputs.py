"""No command destroys what it reads, or another output, whatever its output is called."""

import json
import os
import shlex
import stat
import threading
from pathlib import Path

import polars as pl
import pytest
from studio import run, safe_and_unsafe

from safestage_eval.formats import load, save

RULES = """
[ruleset]
format = 1
name = "mine"
version = "1.0"
extends = ["fsh"]
"""

OUTCOME = {
    "task": "t", "stage": "FSH", "policy": "p", "prompt": "default", "seed": 0, "rollout": 0,
    "success": True, "violation": False,
}  # fmt: skip

WRITERS = {
    "score {mcap} -r {rules} -o": "jsonl",
    "score {mcap} -r {rules} -f csv -o": "csv",
    "score {mcap} -r {rules} --update-golden --golden": "json",
    "score {mcap} -r {rules} -f parquet --what-if all -o": "parquet",
    "report tables {rows} -o": "json",
    "compare {rows} {rows} --by policy -o": "md",
    "label agreement {labels} --results {rows} -o": "csv",
    "audit {mcap} -r {rules} -o": "sarif",
    "compare verdicts {rows} {rows} -o": "json",
    "sweep {mcap} -r {rules} -p edge -o": "csv",
    "sweep {mcap} -r {rules} -p edge -o {other}.csv --plot": "svg",
    "sweep slack {rows} -o": "json",
    "rules test {rules} -o": "xml",
    "import guess {mcap} -o": "toml",
    "plot {mcap} 'edge_margin(target)' -r {rules} -o": "svg",
    "report {rows} {mcap} -r {rules} -o": "html",
    "view {mcap} -r {rules} -o": "html",
    "convert {mcap} -r {rules} --force --to mcap --out": "mcap",
    "import {mcap} --bind {rules} --write-map": "toml",
    "label {mcap} -r {rules} --no-open -l": "csv",
    "plot film {mcap} -r {rules} -o": "gif",
    "label sheets close-up {folder} 1 --from 0 --to 1 -r {rules} -o": "png",
    "label sheets enter {folder} {labels} -l": "csv",
    "bench tasks show {mcap} --picture": "png",
    "bench learn train bc --data {dataset} --out": "onnx",
}  # fmt: skip
"""Command that writes a file → an ending that it can write. The file's name is appended."""

FOLDERS = (
    "convert {dataset} --to parquet --out",
    "convert pack {dataset} --out",
    "import {dataset} --to",
    "report {dataset} -o",
    "view {dataset} -o",
    "score {dataset} --resume",
    "label sheets draw {dataset} --out",
    "bench learn export {dataset} --out",
)  # fmt: skip
"""Commands that write a folder, with what they read."""


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    return safe_and_unsafe(tmp_path_factory.mktemp("recorded"))


@pytest.fixture
def here(tmp_path, recorded, monkeypatch):
    """A folder of each kind of thing that commands read."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.mcap").write_bytes((recorded / "safe.mcap").read_bytes())
    save(load(tmp_path / "a.mcap"), tmp_path / "dataset", "parquet")
    (tmp_path / "mine.toml").write_text(RULES)
    (tmp_path / "rows.jsonl").write_text(json.dumps(OUTCOME))
    (tmp_path / "labels.csv").write_text("episode_id,label\nsafe,safe\n")
    (tmp_path / "study").mkdir()
    return tmp_path


NAMES = {
    "mcap": "a.mcap", "dataset": "dataset", "rules": "mine.toml", "rows": "rows.jsonl",
    "labels": "labels.csv", "folder": "study", "other": "other",
}  # fmt: skip


def filled(command):
    return shlex.split(command.format(**NAMES))


def files(folder):
    return {
        path.relative_to(folder): (path.readlink() if path.is_symlink() else path.read_bytes())
        for path in folder.rglob("*")
        if path.is_symlink() or path.is_file()
    }


def refused(command, output, here):
    """A run that ends at once with one line that names the output, and changes no file."""
    before = files(here)
    done = run(*filled(command), output)
    assert (done.code, done.out) == (2, b""), done.err
    assert done.err.count("\n") == 1
    assert str(output) in done.err
    assert files(here) == before
    return done.err


@pytest.mark.parametrize("victim", ["input", "hard link", "symlink", "rules", "in a dataset"])
@pytest.mark.parametrize("command", WRITERS)
def test_nothing_that_is_read_is_replaced(here, command, victim):
    ending = WRITERS[command]
    output = here / f"victim.{ending}"
    read = next((name for name in ("mcap", "rows", "labels") if "{" + name + "}" in command), None)
    if victim == "in a dataset" or read is None:
        output = here / "dataset" / "meta" / "episodes" / f"victim.{ending}"
        command = command.replace("{mcap}", "{dataset}") if ending == "mcap" else command
    elif victim == "input":
        Path(NAMES[read]).rename(output)
        command = command.replace("{" + read + "}", str(output))
    elif victim == "hard link":
        os.link(NAMES[read], output)
    elif victim == "symlink":
        output.symlink_to(NAMES[read])
    elif "{rules}" in command:
        output.symlink_to(NAMES["rules"])
    else:
        pytest.skip("reads no rules")
    refused(command, output, here)


@pytest.mark.parametrize("command", WRITERS)
def test_a_device_stays_one(here, command):
    device = here / f"device.{WRITERS[command]}"
    try:
        os.mknod(device, 0o666 | stat.S_IFCHR, os.makedev(1, 3))
    except PermissionError:
        pytest.skip("only root makes devices")
    if command.startswith("label {"):
        pytest.skip("serves until it is interrupted")
    run(*filled(command), device)
    assert stat.S_ISCHR(device.stat().st_mode)
    assert not list(here.glob("*.part"))


@pytest.mark.parametrize(
    "command",
    [
        "report tables {rows} -f csv -o",
        "import guess {mcap} -o",
        "plot {mcap} 'edge_margin(target)' -r {rules} -o",
    ],
)
def test_a_pipe_gets_the_bytes_of_a_file(here, recorded, command):
    ending = {"report": "csv", "import": "toml", "plot": "png"}[command.split()[0]]
    assert run(*filled(command), here / f"file.{ending}").code == 0
    pipe, got = here / f"pipe.{ending}", []
    os.mkfifo(pipe)
    reader = threading.Thread(target=lambda: got.append(pipe.read_bytes()))
    reader.start()
    assert run(*filled(command), pipe).code == 0
    reader.join(60)
    assert got == [(here / f"file.{ending}").read_bytes()]
    assert stat.S_ISFIFO(pipe.stat().st_mode)


@pytest.mark.parametrize("output", ["-", "/dev/stdout"])
def test_stdout_by_name(here, output):
    done = run("import", "guess", "a.mcap", "-o", output)
    assert (done.code, done.out) == (0, run("import", "guess", "a.mcap").out)


def test_a_link_stays_and_its_target_is_written(here):
    (here / "real").mkdir()
    (here / "link.toml").symlink_to("real/guesses.toml")
    for _ in range(2):
        assert run("import", "guess", "a.mcap", "-o", "link.toml").code == 0
        assert Path("link.toml").readlink() == Path("real/guesses.toml")
    assert (here / "real" / "guesses.toml").read_bytes() == run("import", "guess", "a.mcap").out


@pytest.mark.parametrize("name", ["itself", "hard link", "symlink"])
@pytest.mark.parametrize(
    ("command", "first", "second"),
    [
        ("score {mcap} -o one.json --update-golden --golden", "one.json", "two.json"),
        (
            "score {mcap} -f parquet -o x.parquet --what-if all --update-golden --golden",
            "x.what-if.parquet",
            "two",
        ),
        ("sweep {mcap} -p edge -o one --plot", "one", "two"),
    ],
)
def test_two_outputs_are_two_files(here, command, first, second, name):
    if name == "itself":
        second = first if "what-if" not in first else "x.parquet"
    else:
        (here / first).write_text("x")
        (os.link if name == "hard link" else os.symlink)(first, second)
    refused(command, second, here)


@pytest.mark.parametrize("command", FOLDERS)
@pytest.mark.parametrize(
    "place", ["dataset", "dataset/inside", "dataset/meta/new", "rows.jsonl", "pipe"]
)
def test_no_folder_is_written_into_what_is_read(here, command, place):
    os.mkfifo(here / "pipe")
    if place == "pipe" and command.split()[0] in ("report", "view"):
        pytest.skip("a page can go through a pipe")
    refused(command, here / place, here)


@pytest.mark.parametrize("command", ["report {mcap} -o", "view {mcap} -o"])
def test_a_report_does_not_empty_the_folder_of_its_sources(here, command):
    (here / "old" / "data").mkdir(parents=True)
    (here / "old" / "data" / "run.js").write_text("")
    Path("a.mcap").rename("old/data/a.mcap")
    refused(command.replace("{mcap}", "old/data/a.mcap"), here / "old", here)


def test_a_shell_pattern_does_not_replace_the_first_recording(here, recorded):
    for name in ("x.mcap", "y.mcap", "z"):
        (here / name).write_bytes((recorded / "safe.mcap").read_bytes())
    before = files(here)
    for first in ("x.mcap", "z"):
        assert run("score", "-f", "json", "-o", first, "a.mcap", "y.mcap").code == 2
    assert files(here) == before


def test_a_copy_does_not_replace_another_source(here):
    (here / "two").mkdir()
    for name in ("a", "safe"):
        (here / "two" / f"{name}.mcap").write_bytes((here / "a.mcap").read_bytes())
    before = files(here)
    done = run("convert", "two", "--to", "mcap", "--no-events", "--force", "--out", "two")
    assert done.code == 2
    assert "would replace its source" in done.err
    assert files(here) == before


# ---- formats by ending


ROWS = ["score", "a.mcap", "-r", "fsh"]
SAYS = {
    "json": "json", "jsonl": "jsonl", "csv": "csv", "parquet": "parquet", "md": "markdown",
    "xml": "junit", "sarif": "sarif", "txt": "table", "log": "table", "": "table",
}  # fmt: skip


def test_rows_of_every_ending(here):
    for ending, form in SAYS.items():
        for name, options in ((f"by_name.{ending}", []), (f"by_option.{ending}", ["-f", form])):
            assert run(*ROWS, *options, "-o", name.rstrip(".")).code == 0
        one, two = (here / f"{kind}.{ending}".rstrip(".") for kind in ("by_name", "by_option"))
        if ending == "parquet":
            assert pl.read_parquet(one).equals(pl.read_parquet(two))
        else:
            assert one.read_bytes() == two.read_bytes(), ending
    assert json.loads((here / "by_name.json").read_text())["episodes"]


@pytest.mark.parametrize(
    ("command", "output", "said"),
    [
        ("score a.mcap -f json", "x.csv", "--format json contradicts the ending .csv"),
        ("score a.mcap -f table", "x.JSON", "--format table contradicts the ending .json"),
        ("score a.mcap", "x.html", "safestage report writes pages"),
        ("score a.mcap", "x.tex", "cannot write .tex"),
        ("score a.mcap", "x.toml", "cannot write .toml"),
        ("score a.mcap", "x.mcap", "cannot write .mcap"),
        ("report tables rows.jsonl", "x.parquet", ".json, .csv, .md, .tex"),
        ("report tables rows.jsonl -f latex", "x.md", "contradicts"),
        ("compare rows.jsonl", "x.jsonl", "cannot write .jsonl"),
        ("label agreement labels.csv --results rows.jsonl", "x.xml", "cannot write .xml"),
        ("audit a.mcap", "x.csv", ".json, .xml, .sarif"),
        ("compare verdicts rows.jsonl rows.jsonl", "x.tex", "cannot write .tex"),
        ("sweep slack rows.jsonl", "x.md", "cannot write .md"),
        ("sweep a.mcap -p edge", "x.md", "cannot write .md"),
        ("rules test mine.toml", "x.csv", ".xml"),
        ("import guess a.mcap", "x.json", ".toml"),
        ("plot a.mcap", "x.json", ".png, .svg, .pdf"),
        ("report rows.jsonl", "x.csv", ".html"),
        ("convert a.mcap --to parquet", "x.parquet", ".mcap, .rrd"),
        ("plot film a.mcap", "x.png", ".mp4, .gif, .webp"),
    ],
)
def test_an_ending_of_another_format_is_refused(here, command, output, said):
    assert said in refused(command + (" --out" if "convert" in command else " -o"), output, here)


def test_sarif_may_be_called_json(here):
    assert run("audit", "a.mcap", "-f", "sarif", "-o", "x.json").code in (0, 1)
    assert json.loads((here / "x.json").read_text())["runs"]
