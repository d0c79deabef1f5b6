"""A file that is taken for results by mistake: one line says what it is, and what writes results."""

import pytest
from studio import run, safe_and_unsafe

from safestage_eval.formats import load, save

SAID = {
    "safe.mcap": "is a recording (MCAP)",
    "recorded.zip": "is a ZIP file",
    "mine.toml": "is a TOML file",
    "commented.toml": "is a TOML file",
    "table.txt": "is text, or a table of something else: 'Judged 2 of 2 episodes'",
    "other.csv": "is text, or a table of something else: 'joint, torque'",
    "empty.csv": "is an empty file",
    "blank.csv": "is an empty file",
    "picture.png": "is not a table",
    "page.html": "is a web page, or XML",
    "junit.xml": "is a web page, or XML",
    "bytes": "is not a table",
    "audit.json": "is text, or a table of something else",
    "golden.json": "is JSON, but no results",
    "dataset/meta/episodes/episode-000000.parquet": "is a table of recordings",
    "dataset/bodies/episode-000000.parquet": "is a table of recordings",
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = safe_and_unsafe(tmp_path_factory.mktemp("files"))
    save(load(folder / "safe.mcap"), folder / "dataset", "parquet")
    for name, content in {
        "recorded.zip": b"PK\x03\x04" + bytes(60),
        "mine.toml": b'[ruleset]\nformat = 1\nname = "mine"\n',
        "commented.toml": b"#:schema rules.json\n\n# mine\n[[rule]]\n",
        "table.txt": b"Judged 2 of 2 episodes\n\nViolations: 1 of 2 episodes\n",
        "other.csv": b"joint,torque\n1,2\n",
        "empty.csv": b"",
        "blank.csv": b"\n \n",
        "picture.png": b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR",
        "page.html": b"<!DOCTYPE html>\n<title>x</title>",
        "junit.xml": b"<?xml version='1.0'?>\n<testsuites/>",
        "bytes": b"\x00\x01\x02",
        "audit.json": b'{"checks": [1]}',
        "golden.json": b'{"format": 1, "episodes": {"safe": {}}}',
    }.items():
        (folder / name).write_bytes(content)
    return folder


@pytest.mark.parametrize("name", SAID)
@pytest.mark.parametrize("command", ["report tables", "compare --by policy", "report -o page.htm"])
def test_what_it_is_and_what_writes_results(folder, monkeypatch, command, name):
    monkeypatch.chdir(folder)
    if command.startswith("report -o") and name in ("safe.mcap", "recorded.zip"):
        pytest.skip("a report can be of recordings")
    done = run(*command.split(), name)
    assert (done.code, done.out) == (2, b"")
    assert done.err.startswith(f"error: {name}: {SAID[name]}")
    assert "safestage score TRACES" in done.err
    assert done.err.count("\n") == 1
    assert not (folder / "page.htm").exists()
