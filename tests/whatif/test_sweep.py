"""A sweep says under every value what scoring under that value says."""

import json
from dataclasses import replace

import pytest
from studio import block, run

from safestage_eval.formats import discover, save
from safestage_eval.metrics import outcomes, rates
from safestage_eval.rules import load_rules
from safestage_eval.run.score_traces import score_paths
from safestage_eval.sketch import resolve
from safestage_eval.whatif.sweep import sweep
from safestage_eval.whatif.swept_values import between, chosen, text_of

ROOMS = {"a": 0.004, "b": 0.012, "c": 0.031, "d": 0.2}

FAR_OFF = """
says = "An apple is carried along a bench, and shoves a carton."
duration = "3 s"
table = false
roles = { target = "apple" }
knobs = { away = "40" }
story = [
  { hold = "apple", during = "0.5 to 2.5 s" },
  { move = "apple", by = "0, 0, 6.2 cm", during = "0.8 to 1 s" },
  { move = "apple", by = "{away} + 17.7, 0, 0 cm", during = "1 to 1.5 s" },
  { touch = "carton", by = "apple", side = "-x", force = "2 N", during = "1.5 to 1.8 s" },
  { move = ["apple", "carton"], by = "10, 0, 0 cm", during = "1.5 to 1.8 s" },
  { move = "apple", by = "-5, 0, 0 cm", during = "1.8 to 2 s" },
  { move = "apple", by = "0, 0, -6.2 cm", during = "2 to 2.4 s" },
]
[bodies.bench]
shape = "box 400 x 100 x 4 cm"
at = "100, 0, -4 cm"
kind = "fixture"
[bodies.apple]
shape = "sphere 7.6 cm"
at = "-25, 0 cm"
mass = "180 g"
[bodies.carton]
shape = "box 7 x 7 x 20 cm"
at = "{away}, 0 cm"
mass = "500 g"
"""


@pytest.fixture(scope="module")
def shelf(tmp_path_factory):
    """Blocks at different distances from the edge, and one that another rule judges."""
    folder = tmp_path_factory.mktemp("shelf")
    for i, (name, room) in enumerate(ROOMS.items()):
        save(block(name, room=room, policy="xy"[i % 2]), folder / f"{name}.mcap")
    save(block("e", rules=("ETS102",), stage="ETS"), folder / "e.mcap")
    return folder


def scored(folder, **overrides):
    """Rates by scoring, of the episodes that the swept rule is assigned to."""
    results = score_paths([folder], ["fsh"], overrides=overrides).results
    return rates(outcomes(r for r in results if r.assigned))


@pytest.mark.parametrize(
    ("param", "first", "last"),
    [("edge", "0 cm", "4 cm"), ("settle_time", "0.1 s", "6 s"), ("still", "0 m/s", "1 cm/s"),
     ("hold_time", "1 s", "8 s"), ("moving_for", "0.1 s", "1 s")],
)  # fmt: skip
def test_each_value_is_judged_as_by_scoring(shelf, param, first, last):
    values = between(load_rules(["fsh"]), param, first, last, 9)
    found = sweep(discover([shelf]), ["fsh"], param, values)
    (curve,) = found.curves().values()
    assert [text_of(v) for v in found.values] == [text_of(v) for v in values]
    for value, cell in zip(values, curve, strict=True):
        assert cell == scored(shelf, **{param: text_of(value)})
    assert found.unread == 1


def test_who_is_at_risk_and_how_far_it_got_are_swept_too(tmp_path):
    """``workspace`` says who is a bystander, so that what lies far off is not at risk below it."""
    scenes = tmp_path / "scenes"
    scenes.mkdir()
    (scenes / "far_off.toml").write_text(FAR_OFF, "utf-8")
    for away in (40, 100, 150):
        episode = resolve(f"far_off(away = {away})", [scenes])
        header = episode.header.model_copy(update={"rules": ("ETS106",), "episode_id": str(away)})
        save(replace(episode, header=header), scenes / f"{away}.mcap")
    values = chosen(load_rules(["ets"]), "workspace", ["0.5 m", "1 m", "1.3 m", "3 m"])
    (curve,) = sweep(discover([scenes]), ["ets"], "workspace", values).curves().values()
    for value, cell in zip(values, curve, strict=True):
        results = score_paths([scenes], ["ets"], overrides={"workspace": text_of(value)}).results
        assert cell == rates(outcomes(results))
    at_risk = [cell.given["at risk"]["N"] for cell in curve]
    assert at_risk == sorted(at_risk)
    assert at_risk[0] < at_risk[-1] == 3
    assert None not in [stage for stage, count in curve[0].engagement.items() if count]


def test_the_flip_lies_where_the_margin_says(shelf):
    values = between(load_rules(["fsh"]), "edge", "0 cm", "4 cm", 200)
    flips = sweep(discover([shelf]), ["fsh"], "edge", values).flips()
    assert [f["episode_id"] for f in flips] == ["a", "b", "c"]
    for flip in flips:
        assert flip["below"] < ROOMS[flip["episode_id"]] <= flip["above"] + 1e-9
        assert (flip["from"], flip["to"]) == ("pass", "violation")


def test_a_broken_trace_is_a_problem_and_stops_no_other(shelf, tmp_path):
    whole = (shelf / "a.mcap").read_bytes()
    (tmp_path / "half.mcap").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "a.mcap").write_bytes(whole)
    done = run("sweep", tmp_path, "-r", "fsh", "-p", "edge", "-f", "json")
    assert done.code == 2
    document = json.loads(done.text)
    assert [p["path"] for p in document["problems"]] == [str(tmp_path / "half.mcap")]
    assert {row["n"] for row in document["curve"]} == {1}
    assert "half.mcap" in done.err


@pytest.mark.parametrize("ending", ["png", "svg"])
@pytest.mark.parametrize("by", [[], ["--by", "policy"]])
def test_a_plot_is_drawn(shelf, tmp_path, ending, by):
    path = tmp_path / f"curve.{ending}"
    done = run("sweep", shelf, "-r", "fsh", "-p", "edge", "--steps", "5", "--plot", path, *by)
    assert done.code == 0
    assert path.read_bytes().startswith(b"\x89PNG" if ending == "png" else b"<?xml")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["-p", "egde"], 'did you mean "edge"?'),
        (["-p", "upright"], "no loaded rule reads it. Allowed: "),
        (["-p", "edge", "--from", "1"], "a length (m, cm, mm); its default is 2 cm"),
        (["-p", "edge", "--from", "5 cm", "--to", "1 cm"], "the range is empty"),
        (["-p", "settle_time", "--from", "3 frames", "--to", "1 s"], "both in the same unit"),
        (["-p", "edge", "--values", ","], 'values with commas: --values "1 cm, 2 cm"'),
        (["-p", "edge", "--values", "1 cm", "--to", "1 cm"], "leave out --from and --to"),
        (["-p", "edge", "--set", "edge=1 cm"], "leave one of the two out"),
        (["-p", "push"], ", which no episode is judged by"),
        (["-p", "edge", "--plot", "x.foo"], "a name ending in"),
        (["-p", "edge", "--where", "policy=z"], "none of 5 episodes matches"),
    ],
)
def test_mistakes_are_reported_with_what_would_do(shelf, arguments, said):
    done = run("sweep", shelf, "-r", "fsh", *arguments)
    assert done.code == 2
    assert said in done.err
