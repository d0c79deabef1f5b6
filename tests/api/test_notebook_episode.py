"""Steps of a notebook: load, look at signals, score into a DataFrame."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from recordings import falling_cube
from studio import block, safe_and_unsafe

import safestage_eval as sse
from safestage_eval.evidence.measure import Signals
from safestage_eval.formats import discover, save
from safestage_eval.formats import load as load_plain
from safestage_eval.relations.relations import Relations
from safestage_eval.report.result_rows import COLUMNS
from safestage_eval.rules import load_rules
from safestage_eval.rules.syntax import Call
from safestage_eval.verdicts.evaluate import Evaluator


@pytest.fixture(scope="module")
def traces(tmp_path_factory):
    return safe_and_unsafe(tmp_path_factory.mktemp("traces"))


# ---- load


def test_load_gives_the_whole_episode(traces):
    episode, plain = sse.load(traces / "safe.mcap"), load_plain(traces / "safe.mcap")
    assert isinstance(episode, sse.Episode)
    assert episode.content_hash == plain.content_hash
    assert episode.header == plain.header


def test_what_discover_returns_can_be_loaded(traces):
    for ref in discover(traces):
        assert sse.load(ref).content_hash == ref.content_hash


def test_public_names():
    assert all(getattr(sse, name) is not None for name in sse.__all__)
    with pytest.raises(AttributeError, match="scoer"):
        _ = sse.scoer


# ---- signals


@pytest.fixture(scope="module")
def falling(tmp_path_factory):
    path = tmp_path_factory.mktemp("falling") / "cube.mcap"
    falling_cube(path=path, roles={"target": ("cube",), "others": ("cube", "ball")}).close()
    return sse.load(path)


def test_a_signal_over_time(falling):
    height = falling.signals("height(cube)")
    t = falling.t
    assert height.name == "height(cube)"
    assert height.index.name == "time"
    np.testing.assert_array_equal(height.index, t)
    np.testing.assert_allclose(height, 1 - 4.905 * t * t, atol=1e-6)
    np.testing.assert_allclose(falling.signals("speed(cube)"), 9.81 * t, atol=1e-5)


def test_a_relation_is_one_zero_or_unknown(traces):
    episode = sse.load(traces / "safe.mcap")
    assert (episode.signals("supports(table, block)") == 1).all()
    assert (episode.signals("supported(target)") == 1).all()
    assert (episode.signals("supports(block, table)") == 0).all()


@pytest.mark.parametrize(
    ("expression", "said"),
    [
        ("heigth(cube)", "height"),
        ("height(cub)", "cube"),
        ("height(others)", "cube, ball"),
        ("height(cube, ball)", "1 argument"),
        ("supports(cube)", "2 argument"),
        ("height", "height"),
        ("height(cube", "height"),
        ("", "expression|name|signal"),
    ],
)
def test_names_that_do_not_exist(falling, expression, said):
    with pytest.raises(sse.InputError, match=said):
        falling.signals(expression)


# ---- score


def test_a_frame_with_the_documented_columns(traces):
    frame = sse.score(traces, "fsh").rows
    assert isinstance(frame, pd.DataFrame)
    assert tuple(frame.columns) == COLUMNS
    assert frame.attrs["problems"] == []
    verdicts = frame[frame.rule == "FSH101"].set_index("episode_id").verdict
    assert verdicts.to_dict() == {"safe": "pass", "unsafe": "violation"}


def test_one_path_or_several(traces):
    several = sse.score([traces / "safe.mcap", str(traces / "unsafe.mcap")], ["fsh", "ish"]).rows
    assert set(several.episode_id) == {"safe", "unsafe"}
    assert {code[:3] for code in several.rule} == {"FSH", "ISH"}


def test_problems_are_listed_beside_the_rows(traces, tmp_path):
    save(block("kept"), tmp_path / "kept.mcap")
    (tmp_path / "bad.mcap").write_bytes((traces / "safe.mcap").read_bytes()[:100])
    frame = sse.score(tmp_path, "fsh").rows
    assert set(frame.episode_id) == {"kept"}
    (problem,) = frame.attrs["problems"]
    assert problem["path"] == str(tmp_path / "bad.mcap")
    assert problem["message"]


# ---- what is not known


def stripped(episode, **header):
    """Return the episode with another header."""
    return replace(episode, header=episode.header.model_copy(update=header))


def test_states_of_rules_of_ones_own(traces, tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(
        '[ruleset]\nformat = 1\nname = "mine"\nversion = "1"\n'
        '[state.high]\nof = ["a"]\nwhen = { "height(a)" = ">= 0 cm" }\n'
        '[[rule]]\ncode = "ETS901"\ntitle = "Stay"\nwhy = "So."\n'
        'roles = { target = "object" }\nrequire = { "high(target)" = true }\nexplain = "Low."\n',
        "utf-8",
    )
    episode = sse.load(traces / "safe.mcap")
    assert (episode.signals("high(target)", path) == 1).all()
    with pytest.raises(sse.InputError, match="high"):
        episode.signals("high(target)")


def test_the_notebook_and_the_verdict_agree_on_what_is_unknown(traces):
    """Where a rule's margin is open, the signal is NaN, and where it is not, it is a number."""
    for header in ({}, {"force_source": "none"}):
        episode = stripped(sse.load(traces / "safe.mcap"), **header)
        relations = Relations(Signals(episode))
        rules = load_rules(["fsh"])
        evaluator = Evaluator(relations, rules, rules.params, None)
        for name, bodies in (("supported", ("target",)), ("held", ("target",))):
            body = tuple(episode.header.roles[role][0] for role in bodies)
            band = evaluator.state(Call(name, body), {})
            found = episode.signals(f"{name}({', '.join(bodies)})")
            np.testing.assert_array_equal(found.isna(), band.margin.unknown)
