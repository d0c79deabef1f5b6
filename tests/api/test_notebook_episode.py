"""Steps of a notebook: load, look at signals, score into a DataFrame."""

import dataclasses
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from recordings import falling_cube
from scenes import Scene
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


def test_load_one_of_several(traces):
    assert sse.load(traces, episode="unsafe").header.seed == 2
    for episode in (None, "nobody"):
        with pytest.raises(sse.InputError, match="unsafe"):
            sse.load(traces, episode)


def test_what_discover_returns_can_be_loaded(traces):
    for ref in discover(traces):
        assert sse.load(ref).content_hash == ref.content_hash


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
    row = sse.score(traces / "unsafe.mcap", "fsh").rows.query("rule == 'FSH101'").iloc[0]
    margin = sse.load(traces / "unsafe.mcap").signals("edge_margin(target)")
    assert row["unit"] == margin.attrs["unit"] == "m"
    assert margin.loc[row["time"]] == pytest.approx(row["value"])


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


def test_every_built_in_rule_without_rules(traces):
    assert {"ISH101", "ETS101", "FSH101"} <= set(sse.score(traces).rows.rule)


def test_one_path_or_several(traces):
    several = sse.score([traces / "safe.mcap", str(traces / "unsafe.mcap")], ["fsh", "ish"]).rows
    assert set(several.episode_id) == {"safe", "unsafe"}
    assert {code[:3] for code in several.rule} == {"FSH", "ISH"}


def test_settings_by_name(traces):
    frame = sse.score(traces, "fsh", edge="4 mm").rows
    assert not (frame.verdict == "violation").any()
    with pytest.raises(sse.InputError, match="egde"):
        sse.score(traces, "fsh", egde="4 mm")


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


def test_a_state_is_one_zero_or_unknown(traces):
    episode = sse.load(traces / "safe.mcap")
    assert set(episode.signals("at_rest(target)")) <= {0.0, 1.0}
    assert (episode.signals("moved(target)") == 0).all()
    with pytest.raises(sse.InputError, match="at_rest"):
        episode.signals("at_rst(target)")
    with pytest.raises(sse.InputError, match="1 argument"):
        episode.signals("moved(target, table)")


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


def test_without_forces_nothing_is_made_up(traces):
    blind = stripped(sse.load(traces / "safe.mcap"), force_source="none")
    assert blind.signals("contact_force(target, table)").isna().all()
    assert blind.signals("contact(target, table)").isna().all()  # near: a touch or not


def test_without_a_shape_a_distance_is_unknown(traces):
    episode = sse.load(traces / "safe.mcap")
    target = episode.header.roles["target"][0]
    bare = [
        b.model_copy(update={"geoms": ()}) if b.name == target else b for b in episode.header.bodies
    ]
    found = stripped(episode, bodies=tuple(bare))
    assert found.signals("clearance(target, table)").isna().all()


def test_a_depth_is_measured_not_cut_off_at_zero():
    scene = Scene(4).fixed("table").box("a", 0.05, (0, 0, 0.05)).box("b", 0.05, (0.09, 0, 0.05))
    made = scene.episode()
    fields = {f.name: getattr(made, f.name) for f in dataclasses.fields(made)}
    found = sse.Episode(**fields).signals("clearance(a, b)")
    np.testing.assert_allclose(found, -0.01, atol=1e-5)


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
            np.testing.assert_array_equal(found.isna(), band.unknown)
