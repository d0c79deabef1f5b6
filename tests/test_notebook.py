"""What a notebook does: load, look at signals, score into a DataFrame."""

import numpy as np
import pandas as pd
import pytest
from recordings import falling_cube
from studio import block, safe_and_unsafe

import safestage_eval as sse
from safestage_eval.formats import load as load_plain
from safestage_eval.formats import save
from safestage_eval.report.rows import COLUMNS


@pytest.fixture(scope="module")
def traces(tmp_path_factory):
    return safe_and_unsafe(tmp_path_factory.mktemp("traces"))


# ---- load


def test_load_gives_the_whole_episode(traces):
    episode, plain = sse.load(traces / "safe.mcap"), load_plain(traces / "safe.mcap")
    assert isinstance(episode, sse.Episode)
    assert episode.content_hash == plain.content_hash
    assert episode.header == plain.header


def test_load_one_of_several(traces):
    assert sse.load(traces, episode="unsafe").header.seed == 2
    for episode in (None, "nobody"):
        with pytest.raises(sse.InputError, match="unsafe"):
            sse.load(traces, episode)


def test_public_names():
    assert all(getattr(sse, name) is not None for name in sse.__all__)
    with pytest.raises(AttributeError, match="scoer"):
        _ = sse.scoer


def test_modules_do_not_hide_functions(traces):
    """A submodule that is imported becomes an attribute of its package."""
    sse.score(traces / "safe.mcap", "fsh")
    assert callable(sse.score)
    assert callable(sse.load)


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


def test_a_role_stands_for_its_body(falling):
    by_role, by_body = falling.signals("height(target)"), falling.signals("height(cube)")
    np.testing.assert_array_equal(by_role, by_body)


def test_far_apart_is_beyond_every_threshold(falling):
    """The ball is a metre to the side; clearance is not measured that far."""
    assert np.isposinf(falling.signals("clearance(cube, ball)")).all()


def test_a_relation_is_one_zero_or_unknown(traces):
    episode = sse.load(traces / "safe.mcap")
    assert (episode.signals("supports(table, block)") == 1).all()
    assert (episode.signals("supported(target)") == 1).all()
    assert (episode.signals("supports(block, table)") == 0).all()


def test_signals_match_the_verdict(traces):
    row = sse.score(traces / "unsafe.mcap", "fsh").query("rule == 'FSH101'").iloc[0]
    margin = sse.load(traces / "unsafe.mcap").signals("edge_margin(target)")
    assert row["unit"] == "cm"
    assert 100 * margin.loc[row["time"]] == pytest.approx(row["value"])


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
    frame = sse.score(traces, "fsh")
    assert isinstance(frame, pd.DataFrame)
    assert tuple(frame.columns) == COLUMNS
    assert frame.attrs["problems"] == []
    verdicts = frame[frame.rule == "FSH101"].set_index("episode_id").verdict
    assert verdicts.to_dict() == {"safe": "pass", "unsafe": "violation"}


def test_every_built_in_rule_without_rules(traces):
    assert {"ISH101", "ETS101", "FSH101"} <= set(sse.score(traces).rule)


def test_one_path_or_several(traces):
    several = sse.score([traces / "safe.mcap", str(traces / "unsafe.mcap")], ["fsh", "ish"])
    assert set(several.episode_id) == {"safe", "unsafe"}
    assert {code[:3] for code in several.rule} == {"FSH", "ISH"}


def test_settings_by_name(traces):
    frame = sse.score(traces, "fsh", edge="4 mm")
    assert not (frame.verdict == "violation").any()
    with pytest.raises(sse.InputError, match="egde"):
        sse.score(traces, "fsh", egde="4 mm")


def test_problems_are_listed_beside_the_rows(traces, tmp_path):
    save(block("kept"), tmp_path / "kept.mcap")
    (tmp_path / "bad.mcap").write_bytes((traces / "safe.mcap").read_bytes()[:100])
    frame = sse.score(tmp_path, "fsh")
    assert set(frame.episode_id) == {"kept"}
    (problem,) = frame.attrs["problems"]
    assert problem["path"] == str(tmp_path / "bad.mcap")
    assert problem["message"]
