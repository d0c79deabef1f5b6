"""``inspect``, ``explain``, ``validate`` and ``convert``."""

import json
import re
import shutil

import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from recordings import everything, falling_cube
from studio import block, run, safe_and_unsafe

from safestage_eval.formats import discover, load, save
from safestage_eval.formats.mcap.mcap_messages import EPOCH_NS


@pytest.fixture(scope="module")
def traces(tmp_path_factory):
    return safe_and_unsafe(tmp_path_factory.mktemp("traces"))


# ---- inspect, explain


def test_inspect_says_what_an_episode_is(traces):
    done = run("explain", "scene", traces / "safe.mcap")
    assert done.code == 0
    hash_ = load(traces / "safe.mcap").content_hash
    for fact in ("block_on_table", "still", "FSH101", "360", "1.000 kg", "target", hash_):
        assert fact in done.text


def test_inspect_as_json_is_the_header(traces):
    done = run("explain", "scene", traces, "--episode", "unsafe", "--json")
    header = load(traces / "unsafe.mcap").header
    assert type(header).model_validate_json(done.text) == header


def test_explain_gives_time_value_limit_and_margin(traces):
    done = run("explain", traces / "unsafe.mcap", "--rules", "fsh")
    assert done.code == 0
    for fact in ("violation", "FSH101", "4.50 s", "0.5 cm", "2.0 cm", "-1.5 cm"):
        assert fact in done.text


def test_explain_with_another_threshold(traces):
    done = run("explain", traces, "-e", "unsafe", "-r", "fsh", "--set", "edge=4 mm")
    assert "violation" not in done.text


def test_explain_everything_names_every_rule(traces):
    short = run("explain", traces / "safe.mcap").text
    whole = run("explain", traces / "safe.mcap", "--all").text
    assert "ETS201" in whole
    assert len(whole) > len(short)


@pytest.mark.parametrize("command", ["inspect", "explain"])
def test_which_episode_is_meant(traces, command):
    done = run(command, traces)
    assert done.code == 2
    for fact in ("--episode", "safe", "unsafe"):
        assert fact in done.err
    assert run(command, traces, "-e", "safe").code == 0  # whole ids go before parts of one
    assert run(command, traces, "-e", "unsa").code == 0
    assert "nobody" in run(command, traces, "-e", "nobody").err
    assert "no episode 'unsave', did you mean:\n  unsafe\n" in run(command, traces, "unsave").err


@pytest.mark.parametrize("command", ["inspect", "explain"])
def test_what_cannot_be_read(tmp_path, command):
    (tmp_path / "bad.mcap").write_bytes(b"\x89MCAP0\r\n" + b"\0" * 50)
    done = run(command, tmp_path / "bad.mcap")
    assert (done.code, done.out) == (2, b"")
    assert "bad.mcap" in done.err
    assert "Traceback" not in done.err


# ---- validate


def listed(text):
    """Ids of the lines ``hash  id  path``."""
    return {line.split()[1] for line in text.splitlines()}


def test_sound_traces(traces):
    done = run("audit", "--files", traces)
    assert done.code == 0
    assert listed(done.text) == {"safe", "unsafe"}
    assert f"safestage audit {traces} says whether what they record makes sense" in done.err


def test_a_broken_trace_among_sound_ones(traces, tmp_path):
    shutil.copytree(traces, tmp_path, dirs_exist_ok=True)
    data = (tmp_path / "safe.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(data[: len(data) // 2])
    done = run("audit", "--files", tmp_path)
    assert done.code == 2
    assert listed(done.text) == {"safe", "unsafe"}
    assert "cut.mcap" in done.err


# ---- convert


@pytest.fixture
def source(tmp_path):
    folder = tmp_path / "source"
    falling_cube("cube").close(folder / "cube.mcap")
    save(everything().episode(), folder / "everything.mcap")
    return folder


def hashes(folder):
    return {ref.episode_id: ref.open().content_hash for ref in discover(folder)}


def test_there_and_back(source, tmp_path):
    data, back = tmp_path / "data", tmp_path / "back"
    before = {p: p.read_bytes() for p in source.iterdir()}
    assert run("convert", source, "--to", "parquet", "--out", data).code == 0
    assert run("convert", data, "--to", "mcap", "--out", back).code == 0
    assert hashes(source) == hashes(data) == hashes(back)
    assert {p: p.read_bytes() for p in source.iterdir()} == before


def test_convert_prints_the_hashes(source, tmp_path):
    done = run("convert", source, "--to", "parquet", "--out", tmp_path / "data")
    found = dict(reversed(line.split()[:2]) for line in done.text.splitlines())
    assert found == hashes(source)


def test_files_are_not_overwritten_without_force(source, tmp_path):
    out = tmp_path / "out"
    save(block("cube"), out / "cube.mcap")
    kept = (out / "cube.mcap").read_bytes()
    done = run("convert", source, "--to", "mcap", "--out", out)
    assert done.code == 2
    assert "--force" in done.err
    assert (out / "cube.mcap").read_bytes() == kept
    assert "everything" in hashes(out)  # the other one is not stopped
    assert run("convert", source, "--to", "mcap", "--out", out, "--force").code == 0
    assert hashes(out) == hashes(source)


@pytest.mark.parametrize("command", ["explain", "inspect"])
def test_the_episode_may_be_named_as_an_argument(tmp_path, command):
    safe_and_unsafe(tmp_path)
    by_option = run(command, tmp_path, "--episode", "unsafe")
    assert by_option.code == 0
    assert run(command, tmp_path, "unsafe").text == by_option.text
    done = run(command, tmp_path, "unsafe", "--episode", "unsafe")
    assert done.code == 2
    assert "name the episode once" in done.err


def test_a_path_that_is_not_there_is_reported_in_whole_sentences(tmp_path):
    done = run("explain", "scene", tmp_path / "nowhere")
    assert "no such file or folder. Fix: check the spelling." in done.err


def logs(file):
    with file.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        found = reader.iter_decoded_messages(topics=["/events"])
        return [((m.log_time - EPOCH_NS) / 1e9, log) for _, _, m, log in found]


def test_an_mcap_copy_tells_the_verdicts_at_their_time(traces, tmp_path):
    done = run("convert", traces, "--to", "mcap", "--out", tmp_path / "out", "--rules", "fsh")
    assert done.code == 0
    lines = logs(tmp_path / "out/unsafe.mcap")
    judged = json.loads(run("score", traces, "--rules", "fsh", "--format", "json").text)
    rows = [row for row in judged["episodes"] if row["episode_id"] == "unsafe"]
    violated = {row["rule"]: row for row in rows if row["violation"]}
    assert violated
    begun = {log.name: (t, log) for t, log in lines if re.search("violation.*: ", log.message)}
    assert set(begun) == set(violated)
    for code, (t, log) in begun.items():
        assert t == pytest.approx(violated[code]["time"], abs=1e-6)
        assert violated[code]["explanation"] in log.message
        assert log.level == log.ERROR
    assert not [log for _, log in logs(tmp_path / "out/safe.mcap") if log.level == log.ERROR]
    assert [ref.content_hash for ref in discover(tmp_path / "out")] == [
        ref.content_hash for ref in discover(traces)
    ]


def test_a_limit_of_another_size_moves_the_events(traces, tmp_path):
    for value, violated in (("4 mm", False), ("2 cm", True)):
        out = tmp_path / value.replace(" ", "")
        run("convert", traces, "--to", "mcap", "--out", out, "-r", "fsh", "--set", f"edge={value}")
        moved = any("violation" in log.message for _, log in logs(out / "unsafe.mcap"))
        assert moved is violated


def test_a_copy_without_events_is_a_copy(traces, tmp_path):
    run("convert", traces, "--to", "mcap", "--out", tmp_path, "--no-events")
    assert {log.name for _, log in logs(tmp_path / "unsafe.mcap")} == {"safestage"}


def test_rules_are_for_events_only(traces, tmp_path):
    done = run("convert", traces, "--to", "parquet", "--out", tmp_path, "--rules", "fsh")
    assert done.code == 2
    assert "--to mcap" in done.err
