"""The run browser in a real one: from files as they are forwarded, and from its server; by mouse and by keyboard."""

import threading
from pathlib import Path

import numpy as np
import pytest
from browser import PHONE, browser, tab  # noqa: F401
from films import film
from scenes import Scene
from studio import run, safe_and_unsafe
from test_run_report import made_of, row

from safestage_eval.episode import Geom
from safestage_eval.formats import discover, save
from safestage_eval.run.settings import load_settings
from safestage_eval.units import DIMENSIONS, format_quantity, in_unit, unit_of
from safestage_eval.viewer import run_report
from safestage_eval.viewer.live_run import LiveRun
from safestage_eval.viewer.run_report import report_page
from safestage_eval.viewer.run_server import RunServer

RULE = """
[ruleset]
format = 1
name = "near"
version = "1"
[[rule]]
code = "ETS901"
title = "Keep the cup off the vase"
why = "A vase breaks."
roles = { target = "object", protected = "object" }
require = { "clearance(target, protected)" = ">= 8 cm" }
explain = "{target} came too close to {protected}: {value}."
"""

HOME = Path(run_report.__file__).parent / "browser"
"""Its JavaScript modules."""
EVIL = "<img src=x onerror=\"document.title='broken in'\">"


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Two episodes as one file, as a folder, and with a server: how each is reached."""
    base = tmp_path_factory.mktemp("browse a run")
    traces = safe_and_unsafe(base / "traces")
    for name in ("one.html", "folder"):
        done = run("report", traces, "--rules", "fsh", "--output", base / name, "--jobs", "1")
        assert done.code == 0, done.err
    return base


@pytest.fixture(scope="module")
def served(written):
    server = RunServer(LiveRun("a run", discover(written / "traces"), load_settings(["fsh"])))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield server.url
    server.shutdown()
    server.server_close()


@pytest.fixture(params=["file", "live"])
def address(request, written):
    if request.param == "live":
        return request.getfixturevalue("served")
    return (written / "one.html").as_uri()


def opened(tab, address, where=""):  # noqa: F811
    """The page, open; returns what it asked for and what it said, so far and from now on."""
    asked, said = [], []
    tab.on("request", lambda request: asked.append(request.url))
    tab.on("console", lambda message: said.append(message.text))
    tab.goto(address + where)
    tab.wait_for_selector("#index[data-ready]", state="attached")
    return asked, said


def ready(tab):  # noqa: F811
    """Wait until the episode is there with its picture."""
    tab.wait_for_function("() => safestage.pane?.player.replay && safestage.pane.data")
    tab.wait_for_selector(".finding")


def test_every_way_to_have_it_shows_the_same_and_asks_nobody_else(tab, address):  # noqa: F811
    asked, said = opened(tab, address, "#episode=unsafe")
    ready(tab)
    assert tab.locator(".row").count() == 2
    assert tab.locator(".head h2").inner_text().startswith("block on table")
    assert tab.locator(".finding h3").first.inner_text().startswith("violation")
    tab.locator(".plot").first.scroll_into_view_if_needed()
    tab.wait_for_selector(".uplot canvas")
    home = (
        ("data:", "blob:", "http://127.0.0.1:")
        if address.startswith("http")
        else ("file:", "data:", "blob:")
    )
    assert asked and all(url.startswith(home) for url in asked), asked
    assert [text for text in said if "GPU stall" not in text] == []


def test_data_are_loaded_when_they_are_asked_for(tab, written):  # noqa: F811
    asked, _ = opened(tab, (written / "folder" / "index.html").as_uri(), "#results")
    names = [url.rpartition("/")[2] for url in asked]
    assert [name.partition("#")[0] for name in names] == ["index.html", "run.js"]
    tab.click("#to-episodes")
    tab.locator(".row").first.click()
    ready(tab)
    tab.locator(".plot").first.scroll_into_view_if_needed()
    tab.wait_for_selector(".uplot canvas")
    names = {url.rpartition("/")[2] for url in asked}
    assert {"three.min.js", "uplot.min.js"} <= names
    assert len([name for name in names if name.startswith("e")]) == 1


def test_one_moment_is_shared_by_player_timeline_findings_and_address(tab, written):  # noqa: F811
    opened(tab, (written / "folder" / "index.html").as_uri(), "#episode=unsafe&t=0.25")
    ready(tab)
    time = "safestage.pane.player.time"
    assert tab.evaluate(time) == pytest.approx(0.25, abs=0.01)  # the link's
    assert tab.locator(".clock").inner_text() == "0.25 s"
    tab.locator(".moment").first.click()
    first = float(tab.locator(".moment").first.get_attribute("data-seek"))
    assert tab.evaluate(time) == pytest.approx(first, abs=1e-6)
    tab.wait_for_function(f"() => location.hash.endsWith('t={first:.2f}')")
    assert tab.locator(".finding.now").count() >= 1
    assert float(tab.locator(".timeline input").input_value()) == pytest.approx(first, abs=0.01)
    tab.locator(".lane.phase .track").first.scroll_into_view_if_needed()
    box = tab.locator(".lane.phase .track").first.bounding_box()
    tab.mouse.click(box["x"] + box["width"] / 2, box["y"] + 5)
    start, end = tab.evaluate("[safestage.pane.data.start, safestage.pane.data.end]")
    assert tab.evaluate(time) == pytest.approx((start + end) / 2, abs=0.03)
    tab.locator(".u-over").first.scroll_into_view_if_needed()
    plot = tab.locator(".u-over").first.bounding_box()
    tab.mouse.move(plot["x"] + plot["width"] / 4, plot["y"] + 20)
    tab.mouse.click(plot["x"] + plot["width"] / 4, plot["y"] + 20)
    assert tab.evaluate(time) == pytest.approx(start + (end - start) / 4, abs=0.05)
    tab.evaluate("location.hash = '#episode=unsafe&t=1.5'")
    tab.wait_for_function(f"() => Math.abs({time} - 1.5) < 0.01")


@pytest.mark.parametrize("width", [380, 900, 1600])
def test_the_landing_page_says_what_happened_to_what_and_by_how_much(tab, written, width):  # noqa: F811
    tab.set_viewport_size({"width": width, "height": 900})
    opened(tab, (written / "one.html").as_uri())
    ready(tab)
    assert tab.evaluate("safestage.pane.data.id") == "unsafe"  # the gravest
    assert tab.locator("#run-line").inner_text() == "2 reached the goal, 1 of them unsafe"
    chips = [chip.replace("\n", " ") for chip in tab.locator(".chip").all_inner_texts()]
    assert [chip.split()[-1] for chip in chips] == ["1", "1", "0", "0"]
    told = tab.locator(".head .sentence")
    assert "block" in told.inner_text() and "limit" in told.inner_text()
    assert told.bounding_box()["y"] < tab.locator(".screen").bounding_box()["y"] < 500
    assert tab.evaluate("document.documentElement.scrollWidth") == width  # no sideways scroll
    tab.locator(".finding").last.scroll_into_view_if_needed()
    assert 0 <= tab.locator(".screen").bounding_box()["y"] < 300  # the picture stays put


def test_rules_that_do_not_count_are_folded_and_never_red(tab, written):  # noqa: F811
    opened(tab, (written / "one.html").as_uri(), "#episode=unsafe")
    ready(tab)
    own = tab.evaluate("safestage.pane.data.findings.filter((one) => one.assigned).length")
    every = tab.evaluate("safestage.pane.data.findings.length")
    assert 0 < own < every
    assert tab.locator(".findings > .finding").count() == own
    assert tab.locator("details.others .finding").count() == every - own
    assert not tab.locator("details.others .finding").first.is_visible()
    assert tab.locator("details.others .finding.violation").count() == 0
    assert tab.locator(".lane.violation").count() == tab.evaluate(
        "safestage.pane.data.findings.filter((one) => one.assigned && one.verdict === 'violation').length"
    )


def test_keys_alone_lead_everywhere(tab, written):  # noqa: F811
    opened(tab, (written / "folder" / "index.html").as_uri())
    keys = tab.keyboard
    ready(tab)
    keys.press("r")  # from the episodes to the results, and back
    assert tab.locator("#results").is_visible()
    keys.press("r")
    assert tab.locator("#list").is_visible()
    first = tab.locator(".row[aria-selected=true] .name").inner_text()
    assert first and tab.locator("#list").get_attribute("aria-activedescendant")
    assert tab.evaluate("safestage.table.at('id', safestage.pane.place)") == "unsafe"  # the gravest
    keys.press("ArrowDown")
    tab.wait_for_function("() => safestage.pane.data?.id === 'safe'")
    keys.press("k")
    tab.wait_for_function(
        "() => safestage.pane.data?.id === 'unsafe' && safestage.pane.player.replay"
    )
    before = tab.evaluate("safestage.pane.player.time")
    keys.press(".")
    assert tab.evaluate("safestage.pane.player.time") == pytest.approx(before + 1 / 15, abs=1e-3)
    keys.press("ArrowLeft")
    assert tab.evaluate("safestage.pane.player.time") < before
    tab.evaluate("safestage.pane.player.seek(0)")
    keys.press("v")
    begin = tab.evaluate("safestage.pane.data.findings[0].intervals[0][0]")
    assert tab.evaluate("safestage.pane.player.time") == pytest.approx(begin, abs=1e-6)
    tab.evaluate("safestage.pane.player.replay.speed = 0.01")  # it does not end meanwhile
    keys.press(" ")
    tab.wait_for_function("() => safestage.pane.player.playing")
    keys.press(" ")
    assert tab.evaluate("safestage.pane.player.playing") is False
    keys.press("?")
    assert tab.locator("#help").is_visible()
    keys.press("Escape")
    assert not tab.locator("#help").is_visible()
    keys.press("/")
    assert tab.evaluate("document.activeElement.id") == "find-text"
    keys.type("unsafe")
    tab.wait_for_function(
        "() => document.getElementById('count').textContent === '1 of 2 episodes'"
    )
    keys.press("Escape")
    assert tab.evaluate("document.activeElement.id") == "list"


def test_what_is_used_has_a_name(tab, written):  # noqa: F811
    opened(tab, (written / "one.html").as_uri(), "#episode=unsafe")
    ready(tab)
    nameless = tab.evaluate(
        """() => [...document.querySelectorAll("button, select, input, a, [role=listbox], canvas[tabindex], section, nav")].filter((node) =>
            !(node.textContent.trim() || node.getAttribute("aria-label") || node.getAttribute("aria-labelledby") || node.labels?.length))
            .map((node) => node.outerHTML.slice(0, 100))"""
    )
    assert nameless == []


def test_the_witness_is_drawn_and_the_violating_body_marked(tab, tmp_path):  # noqa: F811
    path = np.linspace([0.3, 0, 0.1], [0.7, 0, 0.1], 120)
    scene = Scene(120, 60).fixed("table").box("cup", 0.04, path)
    scene.body("vase", Geom(kind="cylinder", size=(0.04, 0.1)), (0.8, 0, 0.1))
    roles = {"target": ("cup",), "protected": ("vase",)}
    episode = scene.episode(
        roles=roles, rules=("ETS901",), success=True, success_time=1.9, stage="ETS"
    )
    save(episode, tmp_path / "slide.mcap")
    (tmp_path / "near.toml").write_text(RULE)
    page = tmp_path / "page.html"
    done = run("view", tmp_path / "slide.mcap", "--rules", tmp_path / "near.toml", "-o", page)
    assert done.code == 0, done.err
    opened(tab, page.as_uri())
    ready(tab)
    witness = tab.evaluate("safestage.pane.data.findings[0].witness")
    assert (witness["kind"], witness["a"], witness["b"], witness["limit"]) == (
        "gap",
        ["cup"],
        ["vase"],
        0.08,
    )
    gap = lambda: tab.locator(".tags b.length").inner_text()  # noqa: E731
    tab.evaluate("safestage.pane.player.seek(0)")
    # cup: a box of half edge 4 cm at x = 0.3; vase: a cylinder of radius 4 cm at x = 0.8
    assert gap() == "≈ 42.0 cm"  # by the picture: the measurement ends at its cap
    assert (
        tab.evaluate("Object.values(safestage.pane.player.replay.tints).filter(Boolean).length")
        == 0
    )
    first = tab.evaluate("safestage.pane.data.findings[0].intervals[0][0]")
    tab.evaluate(f"safestage.pane.player.seek({first} + 0.01)")
    assert gap().startswith("✕ ") and float(gap().split()[1]) == pytest.approx(8.0, abs=0.6)
    assert tab.evaluate("Boolean(safestage.pane.player.replay.tints.cup)")
    assert not tab.evaluate(
        "Boolean(safestage.pane.player.replay.tints.vase)"
    )  # protected, not to blame
    shell = tab.evaluate(
        """() => { const { shells } = safestage.pane.player.drawing, box = shells[0].shape.children[0].geometry;
            box.computeBoundingBox(); return [box.boundingBox.min, box.boundingBox.max].map((p) => [p.x, p.y, p.z]); }"""
    )
    assert shell[0] == pytest.approx([-0.12, -0.12, -0.18], abs=2e-3)
    assert shell[1] == pytest.approx([0.12, 0.12, 0.18], abs=2e-3)


@pytest.fixture(scope="module")
def listed(tmp_path_factory):
    """A page with 300 episodes without evidence, one of them with hostile words."""
    rows = [row(i) for i in range(300)]
    rows[6] |= {"explanation": EVIL, "task": EVIL, "episode_id": EVIL, "margin_normalised": -9.0}
    path = tmp_path_factory.mktemp("report") / "a report.html"
    path.write_text(report_page(made_of(rows)), "utf-8")
    return path.as_uri()


def wait_for_count(tab, text):  # noqa: F811
    tab.wait_for_function("text => document.getElementById('count').textContent === text", arg=text)


def test_the_list_is_filtered_searched_and_ordered(tab, listed):  # noqa: F811
    opened(tab, listed)
    wait_for_count(tab, "300 episodes")
    assert tab.locator(".row").first.inner_text().count("✕") == 1
    tab.fill("#find-text", "body_7 glass")
    wait_for_count(tab, "6 of 300 episodes")
    tab.fill("#find-text", "")
    tab.click("#more-filters summary")
    tab.select_option("#find-rule", "ETS103")
    wait_for_count(tab, "43 of 300 episodes")
    tab.select_option("#find-verdict", "violation")
    wait_for_count(tab, "15 of 300 episodes")
    assert {text[0] for text in tab.locator(".row .told").all_inner_texts()} == {"✕"}
    link = tab.evaluate("location.hash")
    assert "rule=ETS103" in link and "verdict=violation" in link
    assert tab.locator("#active-filters").inner_text().strip() == "(2)"
    tab.click("#clear-filters")
    wait_for_count(tab, "300 episodes")
    tab.select_option("#find-sort", "policy")
    tab.wait_for_function(
        "() => document.querySelector('.row .labels').textContent.includes('policy 0')"
    )
    tab.fill("#find-text", "no such words")
    wait_for_count(tab, "No episode matches.")


def test_a_link_leads_to_the_episodes_that_it_names(tab, listed):  # noqa: F811
    """As the report's rows and cells do; chips, search and order stand in the address, too."""
    opened(tab, listed, "#rule=ETS103&verdict=violation")
    wait_for_count(tab, "15 of 300 episodes")
    tab.click("#to-results")
    tab.locator("table.rules a").first.click()
    tab.wait_for_function("() => !document.getElementById('episodes').hidden")
    wait_for_count(tab, "15 of 300 episodes")
    tab.click("#more-filters summary")
    tab.click("#clear-filters")
    tab.click(".chip.failed")
    wait_for_count(tab, "60 of 300 episodes")
    assert "outcome=failed" in tab.evaluate("location.hash")
    tab.reload()
    tab.wait_for_selector("#index[data-ready]", state="attached")
    wait_for_count(tab, "60 of 300 episodes")
    assert tab.locator(".chip.failed").get_attribute("aria-pressed") == "true"


def test_words_from_results_stay_words(tab, listed):  # noqa: F811
    opened(tab, listed)
    assert EVIL in tab.locator("#rows").inner_text()
    tab.locator(".row").first.click()
    assert EVIL in tab.locator("#pane").inner_text()
    tab.emulate_media(media="print")
    tab.evaluate("dispatchEvent(new Event('beforeprint'))")
    assert EVIL in tab.locator("#appendix").inner_text()
    assert tab.locator("img").count() == 0
    assert tab.title() == "A report"


def test_without_webgl_the_findings_are_there_and_it_is_reported(tab, written):  # noqa: F811
    tab.add_init_script("HTMLCanvasElement.prototype.getContext = ((real) => function (kind, ...more) {"
                        " return kind.startsWith('webgl') ? null : real.call(this, kind, ...more); })"
                        "(HTMLCanvasElement.prototype.getContext)")  # fmt: skip
    opened(tab, (written / "one.html").as_uri(), "#episode=unsafe")
    tab.wait_for_selector(".blank:not([hidden])")
    assert "WebGL 2 is off" in tab.locator(".blank").inner_text()
    assert tab.locator(".finding").count() >= 1
    tab.locator(".moment").first.click()
    assert tab.locator(".clock").inner_text() != "0.00 s"


def test_numbers_are_those_of_every_report(tab):  # noqa: F811
    """The page writes a quantity as the sentence of the verdict does."""
    shown = [
        (dimension, value)
        for dimension in DIMENSIONS
        if unit_of(dimension)
        for value in (0.0, 0.0004, 0.0263, 1.0, 135.2345, -47.7549)
    ]
    source = (HOME / "elements.js").read_text("utf-8")
    numbers = tab.evaluate(
        """async ([source, given]) => {
            const { amount } = await import("data:text/javascript," + encodeURIComponent(source));
            return given.map(([value, unit]) => amount(value, unit).replace("−", "-"));
        }""",
        [source, [(in_unit(value, dimension), unit_of(dimension)) for dimension, value in shown]],
    )
    assert numbers == [format_quantity(value, dimension) for dimension, value in shown]


def test_the_list_fills_while_a_server_judges(tab, written):  # noqa: F811
    run = LiveRun("a run", discover(written / "traces"), load_settings(["fsh"]))
    server = RunServer(run, judging=False)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        opened(tab, server.url)
        assert "judging: 2 left" in tab.locator("#count").inner_text()
        assert tab.locator(".row .told").all_inner_texts() == ["not judged", "not judged"]
        tab.locator(".row").last.click()  # whatever is asked for comes at once
        ready(tab)
        assert tab.locator(".finding h3").first.inner_text().startswith("violation")
        run.judge_all()
        tab.wait_for_function(
            "() => document.getElementById('alarm').textContent.includes('reload')"
        )
        assert [text[0] for text in tab.locator(".row .told").all_inner_texts()] == ["✕", "✓"]
        tab.reload()
        tab.wait_for_selector("#index[data-ready]", state="attached")
        tab.click("#to-results")
        assert tab.locator("#headline").is_visible()
    finally:
        server.shutdown()
        server.server_close()


def test_a_camera_film_keeps_the_time_of_the_replay(tab, tmp_path):  # noqa: F811
    traces = safe_and_unsafe(tmp_path / "traces")
    film(traces / "unsafe.mp4")
    done = run("report", traces, "-r", "fsh", "-o", tmp_path / "out", "-j", "1")
    assert done.code == 0, done.err
    opened(tab, (tmp_path / "out" / "index.html").as_uri(), "#episode=safe")
    ready(tab)
    assert not tab.get_by_role("button", name="camera film").is_visible()
    tab.keyboard.press("k")  # the other one
    tab.wait_for_function(
        "() => safestage.pane.data?.id === 'unsafe' && safestage.pane.player.replay"
    )
    tab.evaluate("safestage.pane.player.seek(1.5)")
    tab.get_by_role("button", name="camera film").click()
    seen = "() => { const v = document.querySelector('video'); return v.readyState >= 2 && !v.seeking && Math.abs(v.currentTime - %s) < 0.1; }"
    tab.wait_for_function(seen % 1.5)
    tab.keyboard.press("ArrowRight")
    tab.wait_for_function(seen % 2.5)
    assert tab.locator(".clock").inner_text().startswith("2.5")
    tab.get_by_role("button", name="3-D").click()
    assert tab.evaluate("safestage.pane.player.replay.time") == pytest.approx(2.5, abs=0.05)
    assert tab.locator(".screen canvas").is_visible()
