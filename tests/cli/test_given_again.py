"""Every command that writes can be given again: after a kill it does the rest, after its end nothing new."""

import pytest
from studio import block, run, safe_and_unsafe

from safestage_eval.formats import discover, save, validate


def contents(folder):
    """File → bytes and when it was written; without what a kill left."""
    return {
        path.relative_to(folder): (path.read_bytes(), path.stat().st_mtime_ns)
        for path in sorted(folder.rglob("*"))
        if path.is_file() and not path.name.endswith((".part", ".lock"))
    }


@pytest.mark.parametrize("form", ["mcap", "parquet"])
def test_convert_does_the_rest(tmp_path, form):
    traces, out = safe_and_unsafe(tmp_path / "in"), tmp_path / "out"
    assert run("convert", traces / "safe.mcap", "--to", form, "--out", out).code == 0
    before = contents(out)
    (out / ".unsafe.mcap.0123abcd.part").write_bytes(b"what a kill left")
    second = run("convert", traces, "--to", form, "--out", out)
    assert second.code == 0, second.err
    assert second.text.count("there already") == 1
    after = contents(out)
    assert {name: after[name] for name in before if name.name != "info.json"} == {
        name: held for name, held in before.items() if name.name != "info.json"
    }
    assert {ref.episode_id for ref in discover(out)} == {"safe", "unsafe"}
    assert validate(out) == []
    third = run("convert", traces, "--to", form, "--out", out)
    assert (third.code, third.text.count("there already")) == (0, 2)
    assert contents(out) == after


@pytest.mark.parametrize("damage", ["cut", "other"])
def test_what_is_not_the_same_is_not_replaced(tmp_path, damage):
    traces, out = safe_and_unsafe(tmp_path / "in"), tmp_path / "out"
    assert run("convert", traces, "--to", "mcap", "--out", out).code == 0
    if damage == "cut":
        (out / "safe.mcap").write_bytes((out / "safe.mcap").read_bytes()[:-1000])
    else:
        save(block("safe", room=0.1), out / "safe.mcap")
    held = (out / "safe.mcap").read_bytes()
    done = run("convert", traces, "--to", "mcap", "--out", out)
    assert done.code == 2
    assert "--force" in done.err
    assert ("not whole" if damage == "cut" else "another content") in done.err
    assert (out / "safe.mcap").read_bytes() == held
    assert run("convert", traces, "--to", "mcap", "--out", out, "--force").code == 0


def test_two_episodes_of_one_file_name_are_reported_each_time(tmp_path):
    for i, name in enumerate(("a b", "a_b")):
        save(block(name), tmp_path / "in" / f"{i}.mcap")
    for _ in range(2):
        done = run("convert", tmp_path / "in", "--to", "mcap", "--out", tmp_path / "out")
        assert done.code == 2
        assert "two episodes would go to this file" in done.err


@pytest.mark.parametrize(
    "command",
    [
        "pack {traces} --out {out}",
        "score {traces} --rules fsh -f json -o {out}/rows.json",
        "score {traces} --rules fsh -f parquet -o {out}/rows.parquet",
        "score {traces} --rules fsh -f csv -o {out}/rows.csv --resume {out}/parts",
        "score {traces} --rules fsh -f csv -o {out}/rows.csv --golden {out}/golden.json --update-golden",
        "audit {traces} -f json -o {out}/audit.json",
        "import guess {traces} -o {out}/bind.toml",
        "view {traces} -e unsafe -o {out}/view.html --no-open",
        "plot {traces} -e unsafe -o {out}/plot.svg",
    ],
)
def test_given_twice_is_given_once(tmp_path, command):
    traces, out = safe_and_unsafe(tmp_path / "in"), tmp_path / "out"
    out.mkdir()
    words = command.format(traces=traces, out=out).split()
    codes, held = [], []
    for _ in range(2):
        done = run(*words)
        assert "Traceback" not in done.err
        codes.append(done.code)
        # what is remembered of files is written once they have not changed for two seconds
        kept = {name: data for name, (data, _) in contents(out).items() if name.name != "headers"}
        held.append(kept)
    assert codes[0] == codes[1]
    assert held[0].keys() == held[1].keys()
    changed = {str(name) for name in held[0] if held[0][name] != held[1][name]}
    assert {name for name in changed if not name.startswith(("plot", "cache", "parts"))} == set()
