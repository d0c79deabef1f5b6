"""While it works the evaluator uses no network, starts no program, and opens no file but those it was given.

``test_no_code_from_data.py`` reads the sources; here processes are watched, with all their libraries.
"""

import json
import os
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from exports import map_text, write_maniskill
from recordings import everything
from scenes import Scene
from studio import block, safe_and_unsafe
from watched import CHECKOUT, OF_PYTHON, WATCH, looked_into, seen

from safestage_eval.formats import save
from safestage_eval.formats.parquet.arrow_tables import TABLES, schema, write_options

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(sys.platform != "linux", reason="events of files are Linux's"),
]
OUR_OWN = (*OF_PYTHON, CHECKOUT)


@pytest.fixture(scope="module")
def worked(tmp_path_factory):
    """Everything that is done with traces and results, and what it did: (events, in, out, work)."""
    base = tmp_path_factory.mktemp("worked")
    given, out, work = base / "given", base / "out", base / "work"
    out.mkdir()
    traces = safe_and_unsafe(given / "traces")
    for i in range(3):
        save(block(f"d{i}", room=0.01 * i, policy="other", rollout=i), given / "dataset")
    still = Scene(30, 20.0).fixed("table").box("cube", 0.02, (0, 0, 0.02)).episode(task="Push")
    (given / "map.toml").write_text(map_text(still))
    demo = write_maniskill(given / "demo", still)
    rows = out / "rows.parquet"
    commands = [
        ["score", given, "-r", "fsh", "-f", "parquet", "-o", rows],
        ["score", given, "-r", "fsh", "-f", "json", "-o", out / "rows.json", "-j", "1",
         "--resume", out / "kept", "--timeout", "60"],
        ["score", given, "--assigned", "-f", "junit"],
        ["audit", "--files", given], ["explain", "scene", traces / "safe.mcap"], ["explain", traces / "unsafe.mcap"],
        ["rules", "check", CHECKOUT / "rules"], ["sweep", given, "-r", "fsh", "-p", "edge", "--values", "1 cm, 2 cm"],
        ["convert", traces / "safe.mcap", "--to", "parquet", "-o", out / "converted"],
        ["convert", "pack", given, "--out", out / "packed"],
        ["import", demo, "--to", out / "imported", "--map", given / "map.toml"],
        ["report", "tables", rows], ["compare", rows, "--by", "policy"],
        ["report", rows, given, "-o", out / "report.html"],
        ["view", traces / "unsafe.mcap", "-o", out / "view.html"],
    ]  # fmt: skip
    return seen(commands, work), given, out, work, commands


def test_everything_was_really_done(worked):
    found, _, out, _, commands = worked
    failed = [
        words[0] for words, code in zip(commands, found.codes, strict=True) if code not in (0, None)
    ]
    assert not failed, found.said
    for name in ("rows.parquet", "rows.json", "converted", "packed", "imported", "report.html", "view.html"):  # fmt: skip
        assert (out / name).exists()
    assert any(path.endswith("safe.mcap") for path in found.of("read"))


def test_no_network(worked):
    assert not worked[0].of("net")


def test_no_program_is_started(worked):
    """But one: importing asks whether MuJoCo is there, and MuJoCo's window library starts Python."""
    assert worked[0].commands_with("run") <= {"import"}


def test_only_what_was_given_is_read_and_only_where_it_was_asked_to_is_written(worked):
    found, given, out, work, _ = worked
    assert not found.outside("read", given, out, work, *OUR_OWN)
    assert not found.outside("write", out, work, *OF_PYTHON, CHECKOUT / "safestage_eval")


def test_the_watch_sees(tmp_path):
    """Otherwise all of this would say nothing."""
    found = seen([["score", "/etc/hostname"]], tmp_path / "work")
    assert "/etc/hostname" in found.outside("read", *OUR_OWN)
    lines = (
        "import socket, subprocess",
        "subprocess.run(['true'])",
        "server = socket.create_server(('127.0.0.1', 0))",
        "socket.create_connection(server.getsockname())",
    )
    log = tmp_path / "events"
    environment = {**os.environ, "PYTHONPATH": str(WATCH), "SAFESTAGE_WATCHED": str(log)}
    subprocess.run([sys.executable, "-c", "\n".join(lines)], env=environment, check=True)
    text = log.read_text()
    assert all(
        f"\n{what}" in text for what in ("net\tsocket.bind", "net\tsocket.connect", "run\tsub")
    )
    secret = tmp_path / "secret"
    secret.write_text("x")
    with looked_into(secret) as opened:
        assert pa.OSFile(str(secret)).read() == b"x"  # C++ opens it; Python knows nothing
    assert opened


SECRET = "the password is swordfish"
UNASKED = (
    "attached",
    "link asset",
    "linked assets",
    "link channels",
    "linked folder channels",
    "link states",
    "linked folder states",
)
"""No rule asks what such a dataset hides behind a name or a link."""


def changed(dataset, table, change):
    [file] = (dataset / table).iterdir()
    rows = pq.read_table(file).to_pylist()
    change(rows)
    pq.write_table(pa.Table.from_pylist(rows, schema(table)), file, **write_options(table))


def hostile(folder, secret):
    """Datasets that try to have a file of somebody else read, each in another way."""
    sound = folder / "sound"
    save(everything("sound", possible=True).episode(), sound)

    def another(name):
        copy = folder / name
        shutil.copytree(sound, copy)
        changed(copy, "meta/episodes", lambda rows: rows[0].update(episode_id=name))
        return copy

    places = {
        "up": f"../../../{secret.name}/secret",
        "absolute": str(secret / "secret"),
        "file": f"file://{secret}/secret",
        "home": f"~/../{secret.name}/secret",
    }
    for way, place in places.items():
        changed(
            another(f"table {way}"),
            "meta/episodes",
            lambda rows, place=place: rows[0].update(file=place),
        )
        attached = json.dumps({"task.toml": f"{place}.parquet"})
        changed(
            another(f"attached {way}"),
            "meta/episodes",
            lambda rows, attached=attached: rows[0].update(attachments=attached),
        )
        copy = another(f"mesh {way}")
        mesh = next(
            row["mesh"] for row in pq.read_table(copy / "geometry").to_pylist() if row["mesh"]
        )
        for table in ("geometry", "meta/episodes"):
            [file] = (copy / table).iterdir()
            rows = json.loads(json.dumps(pq.read_table(file).to_pylist()).replace(mesh, place))
            pq.write_table(pa.Table.from_pylist(rows, schema(table)), file, **write_options(table))
    for table in ("meta/episodes", *TABLES):
        if not (sound / table).is_dir():
            continue
        copy = another(f"link {table.replace('/', ' ')}")
        [file] = (copy / table).iterdir()
        file.unlink()
        file.symlink_to(secret / "secret.parquet")
        copy = another(f"linked folder {table.replace('/', ' ')}")
        shutil.rmtree(copy / table)
        (copy / table).symlink_to(secret)
    copy = another("link asset")
    for file in (copy / "assets").iterdir():
        file.unlink()
        file.symlink_to(secret / "secret.ply")
    copy = another("linked assets")
    for file in (copy / "assets").iterdir():
        shutil.copy(secret / "secret.ply", secret / file.name)
    shutil.rmtree(copy / "assets")
    (copy / "assets").symlink_to(secret)
    copy = another("info")
    (copy / "meta/info.json").unlink()
    (copy / "meta/info.json").symlink_to(secret / "secret.json")
    episode = everything("../../escaped", possible=True).episode()
    names = {f"../../{name}": b"x" for name in ("a.toml", "b/c.toml")} | {"/tmp/d.toml": b"x"}
    save(replace(episode, attachments=names), folder / "names.mcap")


@pytest.fixture
def lured(tmp_path):
    """A folder of such datasets, and somebody's secret beside it."""
    given, secret = tmp_path / "given", tmp_path / "secret"
    given.mkdir()
    secret.mkdir()
    save(everything("other").episode(), tmp_path / "mine")
    for ending in ("parquet", "ply", "json", "toml"):
        (secret / f"secret.{ending}").write_text(f"{SECRET}\n")
    hostile(given, secret)
    return given, secret


def test_no_file_beside_the_dataset_is_opened_and_none_written(lured, tmp_path):
    given, secret = lured
    out = tmp_path / "out"
    out.mkdir()
    commands = [
        ["score", given, "-f", "json", "-o", out / "rows.json"],
        ["score", given, "-f", "jsonl", "-j", "1", "--resume", out / "kept"],
        ["audit", "--files", given],
        ["convert", "pack", given, "--out", out / "packed"],
        ["convert", given / "names.mcap", "--to", "parquet", "-o", out / "converted"],
        ["view", given / "names.mcap", "-o", out / "view.html"],
    ]
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*") if path.is_file()}
    with looked_into(secret, *secret.iterdir()) as opened:
        found = seen(commands, tmp_path / "work")
    assert not opened
    assert not found.outside("read", given, out, tmp_path / "work", *OUR_OWN)
    assert not found.outside(
        "write", out, tmp_path / "work", *OF_PYTHON, CHECKOUT / "safestage_eval"
    )
    outside = [event for event in found.of("net", "run") if str(tmp_path / "work") not in event]
    assert not outside  # workers are asked for over a socket in the temporary folder
    assert SECRET not in found.said
    assert "swordfish" not in (out / "rows.json").read_text()
    after = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*") if path.is_file()}
    new = {path for path in after if before.get(path) != after[path]}
    assert all(path.is_relative_to(out) or path.is_relative_to(tmp_path / "work") for path in new)
    document = json.loads((out / "rows.json").read_text())
    judged = {row["episode_id"] for row in document["episodes"]}
    harmless = {name for name in judged if name.startswith(UNASKED)}
    assert judged - harmless == {"sound", "../../escaped"}
    told_of = {
        Path(problem["path"]).relative_to(given).parts[0] for problem in document["problems"]
    }
    same_file_as_another = {"linked folder meta episodes"}
    silent = {path.name for path in given.iterdir()} - told_of - judged - {"names.mcap"}
    assert silent <= same_file_as_another
