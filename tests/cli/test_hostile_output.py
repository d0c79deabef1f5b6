"""Names, prompts and tasks of strangers, in what every command prints and writes."""

import csv
import io
import json
import re

import pytest
from hostile_text import EVIL, shows_all
from scenes import G, Scene
from studio import run

from safestage_eval.errors import InputError
from safestage_eval.formats import save

FINDING = "FSH101"


@pytest.fixture(scope="module")
def traces(tmp_path_factory):
    """Two episodes whose every text is hostile; one violates its rule."""
    folder = tmp_path_factory.mktemp("traces")
    for i, room in enumerate((0.2, 0.005)):
        x = 0.5 - 0.03 - room
        scene = Scene(360, 60).fixed("table").box("block" + EVIL, 0.03, (x, 0, 0.03))
        scene.rests("block" + EVIL, "table", 0.03, (x, 0, 0), G)
        episode = scene.episode(
            episode_id=f"{EVIL}{i}", task=EVIL, policy=EVIL, prompt=EVIL, instruction=EVIL,
            family=EVIL, notes=(EVIL,), stage="FSH", seed=i, rollout=0, success=True,
            success_time=0.5, termination="success", post_success_hold=5.0,
            roles={"target": ("block" + EVIL,), EVIL: ("table",)}, rules=(FINDING, EVIL),
        )  # fmt: skip
        save(episode, folder / f"{i}.mcap")
    (folder / "broken\x1b[31m\u202e.mcap").write_bytes(b"\x89MCAP0\r\n" + b"\x1b[2J" * 9)
    return folder


COMMANDS = [
    "score {traces} --rules fsh",
    "score {traces} --rules fsh -v",
    "score {traces} --rules fsh -f json",
    "score {traces} --rules fsh -f jsonl",
    "score {traces} --rules fsh -f csv",
    "score {traces} --rules fsh -f markdown",
    "score {traces} --rules fsh -f junit",
    "score {traces} --rules fsh -f github",
    "score {traces} --rules fsh --fail-on violation",
    "score {traces} --rules fsh --where policy=\x1b[31m",
    "score {traces}/no\x1b[31m\u202ething",
    "score {traces} --rules \x1b[31mnone",
    "score {traces} --rules fsh --set edge=\x1b[31m",
    "explain scene {traces}",
    "explain scene {traces}/0.mcap",
    "explain scene {traces}/0.mcap --json",
    "explain scene {traces} -e \x1b[31mnone",
    "explain {traces}/1.mcap",
    "audit --files {traces}",
    "audit {traces}",
    "audit {traces} -f json",
    "audit {traces} -f sarif",
    "score {traces} --rules fsh -f sarif",
    "audit {traces} -f github",
    "import guess {traces}",
    "convert {traces} --to mcap --out {out}",
    "convert pack {traces} --out {out}",
    "sweep {traces} --rules fsh -p edge --values 1cm,3cm",
    "compare verdicts {traces} --rules fsh --set edge=3cm",
    "rules check \x1b[31m\u202enone.toml",
    "rules show \x1b[31mX",
    "plot {traces}/0.mcap \x1b[31m -o {out}/x.svg",
    "import {traces} --to {out}",
    "no\x1b[31msuch",
]


@pytest.mark.parametrize("command", COMMANDS)
def test_nothing_moves_the_cursor_or_turns_the_line(traces, tmp_path, command):
    words = [word.format(traces=traces, out=tmp_path / "out") for word in command.split(" ")]
    done = run(*words)
    assert shows_all(done.text), done.text
    assert shows_all(done.err), done.err
    assert "Traceback" not in done.err
    for line in (done.text + done.err).split("\n"):
        assert not line.startswith("::error::owned")
        assert len(line) < 20_000


@pytest.fixture(scope="module")
def tables(traces, tmp_path_factory):
    """Results of the same episodes, labels by a hostile reviewer, and a golden file."""
    folder = tmp_path_factory.mktemp("tables")
    assert (
        run("score", traces, "--rules", "fsh", "-f", "jsonl", "-o", folder / "rows.jsonl").code == 2
    )
    what_if = ["-f", "parquet", "-o", folder / "rows.parquet", "--what-if", "edge"]
    assert run("score", traces, "--rules", "fsh", *what_if).code == 2
    golden = ["--golden", folder / "golden.json", "--update-golden"]
    assert run("score", traces / "0.mcap", "--rules", "fsh", *golden).code == 0
    with (folder / "labels.csv").open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow(["episode_id", "label", "reviewer", "note"])
        table.writerows([f"{EVIL}{i}", "safe", EVIL, EVIL] for i in range(2))
    return folder


@pytest.mark.parametrize(
    "command",
    [
        "sweep slack {tables}/rows.parquet",
        "sweep {tables}/rows.parquet -p edge --values 1cm,3cm -f csv",
        "report tables {tables}/rows.jsonl",
        "report tables {tables}/rows.jsonl -f markdown",
        "report tables {tables}/rows.jsonl -f csv",
        "report tables {tables}/rows.jsonl -f latex",
        "compare {tables}/rows.jsonl {tables}/rows.jsonl",
        "label agreement {tables}/labels.csv --results {tables}/rows.jsonl",
        "report {tables}/rows.jsonl -o {out}/report.html",
        "score {traces}/1.mcap --rules fsh --golden {tables}/golden.json",
        "score {traces}/1.mcap --rules fsh --golden {tables}/golden.json -f github",
        "score {traces}/1.mcap --rules fsh --golden {tables}/golden.json -f junit",
        "view {traces}/1.mcap -o {out}/page.html --no-open",
    ],
)
def test_what_is_made_of_results_is_as_safe(traces, tables, tmp_path, command):
    words = command.format(traces=traces, tables=tables, out=tmp_path).split(" ")
    done = run(*words)
    assert shows_all(done.text), done.text
    assert shows_all(done.err), done.err
    assert "Traceback" not in done.err
    assert "Usage" not in done.err, "the command was not given as it should be"
    for line in (done.text + done.err).split("\n"):
        assert not line.startswith("::error::owned")
    for page in tmp_path.glob("*.html"):
        assert "<script>alert(1)" not in page.read_text()


def rows_of(traces, form):
    return run("score", traces, "--rules", "fsh", "-f", form).text


def test_json_says_what_the_header_says(traces):
    rows = [json.loads(line) for line in rows_of(traces, "jsonl").splitlines()]
    assert {row["task"] for row in rows} == {EVIL}
    assert (
        json.loads(run("explain", "scene", traces / "0.mcap", "--json").text)["instruction"] == EVIL
    )


def test_markdown_holds_no_tag_no_link_and_no_picture(traces):
    text = rows_of(traces, "markdown")
    assert "HYPERLINK" in text
    outside = re.sub(r"`[^`\n]*`", "", re.sub(r"\\[\\\[\]`|<]", "", text))
    assert not re.findall(r"<[A-Za-z/!?]", outside)
    assert not re.findall(r"\]\(", outside)


def test_markdown_is_inert_in_a_reader(traces):
    """A reader that knows CommonMark finds text alone; an escaped backslash escapes nothing after it."""
    reader = pytest.importorskip("markdown_it").MarkdownIt("commonmark").enable("table")
    html = reader.render(rows_of(traces, "markdown"))
    assert "<script" not in html
    assert "<img" not in html
    assert "javascript:" not in re.sub(r">[^<]*<", "><", html)


def test_names_write_no_lines_of_a_bind_file(traces, tmp_path):
    """A role with a line break in its name wrote whatever it liked into the file of guesses."""
    import tomllib

    out = tmp_path / "bind.toml"
    assert run("import", "guess", traces, "--output", out).code == 0
    tables = tomllib.loads(out.read_text())
    assert "::error::owned" not in {line[:14] for line in out.read_text().splitlines()}
    assert set(tables) <= {"task", "body", "every", "episode"}


def test_files_are_named_within_the_folder(tmp_path):
    from safestage_eval.formats.save import mcap_name

    for name in (
        "../../x",
        "/etc/passwd",
        "x" * 5000,
        "ü" * 5000,
        "\0",
        "a\nb",
        "",
        "..",
        "é" * 81,
    ):
        file = mcap_name(name)
        assert len(file.encode()) < 200
        assert (tmp_path / file).resolve().parent == tmp_path
        (tmp_path / file).write_bytes(b"")
    assert mcap_name("x" * 5000) != mcap_name("x" * 5001)
    assert mcap_name("plain-name.1") == "plain-name.1.mcap"


def test_spreadsheets_calculate_nothing(traces):
    for row in csv.DictReader(io.StringIO(rows_of(traces, "csv"))):
        for value in row.values():
            number = re.fullmatch(r"[+-]?[\d.e+-]+", value)
            assert number or not value.startswith(("=", "+", "-", "@")), value


def test_what_is_read_back_from_csv_is_what_was_written(tmp_path):
    from safestage_eval._text.csv_cell import from_cell, guarded
    from safestage_eval.metrics.read_rows import read_rows

    texts = ["=1+1", "'=1", "''=1", "-5", "-5 cm", "@x", "'quoted'", "plain", "＝1", "+4e3", ""]
    assert [from_cell(guarded(text)) for text in texts] == texts
    assert guarded("-5") == "-5"
    assert guarded("-5 cm") == "'-5 cm"
    path = tmp_path / "rows.csv"
    path.write_text(f"episode_id,label\n{guarded('=a')},safe\n")
    assert [row["episode_id"] for row in read_rows(path, ["episode_id"])] == ["=a"]


def test_messages_have_an_end_and_no_controls():
    names = ", ".join(f"b{i}\x1b[31m" for i in range(200_000))
    text = str(InputError("x" * 10**6, "names " + names, names, names))
    assert len(text) < 4000
    assert "characters left out" in text
    assert shows_all(text)
