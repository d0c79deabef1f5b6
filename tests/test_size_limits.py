"""Few bytes cannot claim much; nothing that was recorded comes near a limit."""

import io
import json
import os
import struct
import subprocess
import sys
import time
import zipfile
from pathlib import Path

import lz4.frame
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import zstandard
from scenes import Scene

from safestage_eval._process.memory_limit import resident
from safestage_eval._text.json_text import from_json
from safestage_eval._text.toml_text import from_toml
from safestage_eval.episode import Header, check_header
from safestage_eval.errors import InputError, TraceError
from safestage_eval.formats import discover, load, save
from safestage_eval.formats.mcap.mcap_metadata import checksum
from safestage_eval.importers.robot_file import read_urdf
from safestage_eval.size_limits import VARIABLE, current

CHECKOUT = Path(__file__).resolve().parents[1]
FAR = 8
"""Times that a limit is above all that was recorded; 4 for time stamps and single texts too."""


def metadata_record(texts):
    def text(value):
        return struct.pack("<I", len(value.encode())) + value.encode()

    pairs = b"".join(text(key) + text(value) for key, value in texts.items())
    content = text("safestage") + struct.pack("<I", len(pairs)) + pairs
    return b"\x0c" + struct.pack("<Q", len(content)) + content


def mcap(*records):
    head = struct.pack("<I", 9) + b"safestage" + struct.pack("<I", 0)
    start = b"\x89MCAP0\r\n" + b"\x01" + struct.pack("<Q", len(head)) + head
    end = b"\x02" + struct.pack("<Q", 20) + bytes(20) + b"\x89MCAP0\r\n"
    return start + b"".join(records) + end


def header_of(bodies, **more):
    return {"schema_version": "1.2", "episode_id": "x", "physics_dt": 0.01, "frame_dt": 0.01,
            "bodies": bodies, **more}  # fmt: skip


def mcap_of(header, *records):
    texts = {"schema_version": "1.2", "header": json.dumps(header), "frames": "1"}
    return mcap(metadata_record(texts | {"checksum": checksum(texts)}), *records)


def crowd(count):
    return [{"name": f"b{i}", "kind": "object"} for i in range(count)]


def as_zip(header):
    file = io.BytesIO()
    about = {"format": "safestage-zip", "version": 1, "frames": 1, "header": header}
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("safestage.json", json.dumps(about))
    return file.getvalue()


@pytest.fixture(scope="module")
def episode():
    return Scene(30, 60).fixed("table").box("cup", 0.04, (0.3, 0, 0.05)).episode(episode_id="cup")


def refused(path, match):
    """The problem with an episode, found in little time and room."""
    before, began = resident_now(), time.process_time()
    with pytest.raises(TraceError, match=match) as caught:
        load(path)
    assert time.process_time() - began < 3
    assert resident_now() - before < 200 << 20
    assert len(str(caught.value)) < 1000
    return str(caught.value)


def resident_now():
    return resident(os.getpid())


@pytest.mark.parametrize(
    ("header", "name"),
    [
        (header_of(crowd(100_000)), "bodies"),
        (header_of(crowd(5_000)), "bodies"),
        (header_of([], joints=[{"name": f"j{i}", "kind": "hinge"} for i in range(2_000)]), "joints"),
        (header_of(crowd(1), instruction="x" * 1_000_000), "text"),
        (header_of(crowd(1), notes=["x" * 100_000]), "text"),
        (header_of([{"name": "x" * 100_000, "kind": "object"}]), "text"),
        (header_of(crowd(1), notes=["x" * 1000] * 17_000), "document"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("form", ["mcap", "zip"])
def test_large_headers_are_refused_before_bodies_are_made(tmp_path, header, name, form):
    path = tmp_path / f"x.{form}"
    path.write_bytes(mcap_of(header) if form == "mcap" else as_zip(header))
    flag = "document=" if form == "zip" and name == "document" else f"{name}="
    assert flag in refused(path, "at most")


@pytest.mark.parametrize(
    ("column", "value", "name"),
    [
        ("bodies", json.dumps(crowd(100_000)), "bodies="),
        ("instruction", "x" * 1_000_000, "text="),
        ("notes", json.dumps(["x" * 1_000_000]), "text="),
        ("bodies", "[" * 17_000_000, "document="),
    ],
)
def test_large_rows_of_a_dataset_are_refused(tmp_path, episode, column, value, name):
    file = changed(
        episode, tmp_path, "meta/episodes", lambda table: with_column(table, column, [value])
    )
    assert name in refused(file, "at most")


def changed(episode, folder, table, change, **how):
    """A dataset of one episode with one of its tables replaced."""
    save(episode, folder / "set", "parquet")
    (path,) = (folder / "set" / table).rglob("*.parquet")
    old = pq.read_table(path, partitioning=None)
    pq.write_table(change(old), path, compression="zstd", write_page_checksum=True, **how)
    return folder / "set"


def with_column(table, name, values):
    place = table.column_names.index(name)
    return table.set_column(place, name, pa.array(values, table.schema.field(name).type))


@pytest.mark.parametrize("as_dictionary", [True, False])
def test_one_text_in_many_rows_is_no_bomb(tmp_path, episode, as_dictionary):
    """A dictionary holds it once: some kilobytes would become a gigabyte."""
    rows = 20_000

    def many(table):
        place = table.column_names.index("instruction")
        text = pa.DictionaryArray.from_arrays(pa.array([0] * rows, pa.int32()), ["y" * 50_000])
        return pa.concat_tables([table] * rows).set_column(place, "instruction", text)

    path = changed(episode, tmp_path, "meta/episodes", many, store_schema=as_dictionary)
    before = resident_now()
    with pytest.raises(TraceError, match="rows with episode_index"):
        discover(path)[0].open()
    assert resident_now() - before < 400 << 20


def test_lists_without_end_are_refused(tmp_path, episode, monkeypatch):
    """One row of a table holds a list of two million zeros, in some hundred bytes."""
    monkeypatch.setenv(VARIABLE, "decoded=4MB")

    def long(table):
        values = pa.concat_arrays([pa.array(np.zeros(2_000_000, np.float32))])
        offsets = pa.array([0] + [2_000_000] * len(table), pa.int32())
        place = table.column_names.index("action")
        return table.set_column(place, "action", pa.ListArray.from_arrays(offsets, values))

    path = changed(episode, tmp_path, "frames", long)
    with pytest.raises(TraceError, match="decoded="):
        _ = load(path).frames.action


@pytest.mark.parametrize("compression", ["lz4", "zstd"])
def test_a_chunk_of_zeros_is_refused_before_it_is_unpacked(tmp_path, compression):
    zeros, count = bytes(1 << 20), 900
    if compression == "zstd":
        packer = zstandard.ZstdCompressor().compressobj(size=count << 20)
        packed = b"".join(packer.compress(zeros) for _ in range(count)) + packer.flush()
    else:
        frame = lz4.frame.LZ4FrameCompressor()
        packed = frame.begin(count << 20)
        packed += b"".join(frame.compress(zeros) for _ in range(count)) + frame.flush()
    content = struct.pack("<QQQI", 0, 0, count << 20, 0) + struct.pack("<I", len(compression))
    content += compression.encode() + struct.pack("<Q", len(packed)) + packed
    path = tmp_path / "zeros.mcap"
    chunk = b"\x06" + struct.pack("<Q", len(content)) + content
    path.write_bytes(mcap_of(header_of(crowd(1)), chunk))
    assert len(packed) < 4 << 20
    assert "decoded=" in refused(path, "stored bytes would become")


def test_names_are_compared_in_linear_time():
    """100,000 bodies took more than half a minute; a chain of parents does not take its square either."""
    bodies = [{"name": f"b{i}", "kind": "object", "parent": f"b{i + 1}"} for i in range(20_000)]
    header = Header.model_validate(header_of(bodies, roles={"r": [f"b{i}" for i in range(2000)]}))
    began = time.process_time()
    assert not list(check_header(header, "x"))
    assert time.process_time() - began < 2


@pytest.mark.parametrize("parse", [from_json, from_toml, lambda text: read_urdf(text, "x")])
def test_texts_have_an_end(parse):
    began = time.process_time()
    with pytest.raises((ValueError, InputError), match="document="):
        parse("[" * 17_000_000)
    assert time.process_time() - began < 1


def test_time_is_bounded_while_an_episode_is_judged(monkeypatch, tmp_path, episode):
    from safestage_eval.run.score_traces import score_paths

    def busy(*_, **__):
        while True:
            pass

    save(episode, tmp_path / "cup.mcap")
    monkeypatch.setattr("safestage_eval.verdicts.judge", busy)
    monkeypatch.setenv(VARIABLE, "seconds=1")
    scores = score_paths([tmp_path], ["fsh"], jobs=1)
    assert "takes more than 1 s of processor time" in scores.problems[0].message


def test_memory_is_bounded_while_an_episode_is_judged(tmp_path, episode):
    """In a process of its own: what it may hold is counted from where it stands."""
    save(episode, tmp_path / "cup.mcap")
    code = (
        "import sys, numpy as np, safestage_eval.verdicts as v\n"
        "from safestage_eval.run.score_traces import score_paths\n"
        "v.judge = lambda *a, **k: np.ones(1 << 28)\n"
        "print(score_paths([sys.argv[1]], ['fsh'], jobs=1).problems[0].message)\n"
        "np.ones(1 << 25)\n"
    )
    run = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path)], check=False, capture_output=True, text=True,
        env={**os.environ, VARIABLE: "memory=200MB"}, timeout=120,
    )  # fmt: skip
    assert "takes more than 200 MiB of memory" in run.stdout, run


def test_one_flag_raises_them(tmp_path, monkeypatch):
    from click.testing import CliRunner

    from safestage_eval.cli import group

    monkeypatch.setenv(VARIABLE, "")
    path = tmp_path / "x.mcap"
    path.write_bytes(mcap_of(header_of(crowd(5_000))))
    run = CliRunner().invoke(group, ["audit", "--files", str(path)])
    assert "--limits bodies=5000" in run.output
    for raised in ("bodies=5000", "none", "bodies=6k, text=1MB"):
        run = CliRunner().invoke(group, ["audit", "--files", "--limits", raised, str(path)])
        assert "at most" not in run.output
    run = CliRunner().invoke(group, ["audit", "--files", "--limits", "bodys=3", str(path)])
    assert run.exit_code == 2


def test_no_recorded_episode_comes_near_them():
    limits = current()
    refs = discover([CHECKOUT / "traces", CHECKOUT / "tests" / "formats" / "golden"])
    assert len(refs) > 10
    for ref in refs:
        if ref.problem is not None:
            continue
        episode = ref.open(checked=False)
        header, frames = episode.header, episode.contacts.frame
        texts = [header.episode_id, header.instruction or "", *header.notes]
        held = {
            "bodies": len(header.bodies),
            "geoms": sum(len(body.geoms) for body in header.bodies),
            "joints": len(header.joints),
            "vertices": max((len(mesh.vertices) for mesh in episode.meshes.values()), default=0),
            "text": max(map(len, texts)),
            "document": len(header.model_dump_json()),
            "frames": len(episode),
            "contacts": int(np.bincount(frames).max()) if len(frames) else 0,
            "decoded": 13 * 4 * len(episode) * len(header.bodies) + 48 * len(frames),
        }
        for name, number in held.items():
            assert FAR * number <= getattr(limits, name), (ref.shown, name)
