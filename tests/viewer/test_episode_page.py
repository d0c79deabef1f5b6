"""``safestage view``: one page, complete in itself, on which everything goes to the same moment."""

import json
import re
from dataclasses import replace

import pytest
from browser import PHONE
from studio import run, safe_and_unsafe

from safestage_eval.formats import load


@pytest.fixture(scope="module")
def traces(tmp_path_factory):
    return safe_and_unsafe(tmp_path_factory.mktemp("view"))


@pytest.fixture(scope="module")
def pages(traces):
    for name in ("safe", "unsafe"):
        out = traces / f"{name}.html"
        done = run("view", traces, name, "--rules", "fsh", "--output", out, "--no-open")
        assert done.code == 0, done.err
        assert done.text.strip() == str(out)
    return traces


def data(path):
    text = path.read_text("utf-8")
    return json.loads(re.search(r'id="view">(.*?)</script>', text, re.S)[1])


def test_the_page_says_what_explain_says(pages):
    rows = json.loads(run("score", pages, "--rules", "fsh", "--format", "json").text)["episodes"]
    violated = [r for r in rows if r["episode_id"] == "unsafe" and r["violation"]]
    assert violated
    found = {f["rule"]: f for f in data(pages / "unsafe.html")["findings"]}
    assert set(found) == {row["rule"] for row in violated}
    for row in violated:
        assert found[row["rule"]]["intervals"] == row["intervals"]
        assert row["explanation"] in (pages / "unsafe.html").read_text("utf-8")
    assert data(pages / "safe.html")["findings"] == []


def test_another_limit_is_another_page(pages, tmp_path):
    out = tmp_path / "page.html"
    run("view", pages, "unsafe", "-r", "fsh", "-o", out, "--no-open", "--set", "edge=4 mm")
    assert "FSH101" not in {f["rule"] for f in data(out)["findings"]}


def test_nothing_is_loaded_from_elsewhere(pages):
    text = (pages / "unsafe.html").read_text("utf-8")
    assert not re.search(r'(?:src|href)="(?!data:|#)', text)
    assert "default-src &#x27;none&#x27;" in text


def test_hostile_names_stay_text(traces, tmp_path):
    from safestage_eval.formats import save

    episode = load(traces, "unsafe")
    name = "</script><script>alert(1)</script>"
    header = episode.header.model_copy(update={"episode_id": name, "instruction": name})
    save(replace(episode, header=header), tmp_path / "bad.mcap")
    out = tmp_path / "bad.html"
    assert run("view", tmp_path / "bad.mcap", "-o", out, "--no-open").code == 0
    assert "<script>alert" not in out.read_text("utf-8")


def test_player_strip_timelines_and_findings_share_one_time(pages, tab):
    asked = []
    tab.on("request", lambda request: asked.append(request.url))
    tab.goto((pages / "unsafe.html").as_uri())
    first = data(pages / "unsafe.html")["findings"][0]["intervals"][0][0]
    now = lambda: tab.evaluate("view.now()")  # noqa: E731
    assert now() == pytest.approx(first, abs=1e-6)  # opens where it matters
    assert tab.locator(".card.now").count() >= 1

    tab.evaluate("view.seek(0)")
    assert tab.locator("[data-clock]").inner_text() == "0.00 s"
    assert tab.locator(".card.now").count() == 0
    tab.locator("[data-seek]").first.click()
    assert now() == pytest.approx(first, abs=1e-3)

    tab.locator("svg.timeline").first.evaluate(
        "(s) => { const b = s.getBoundingClientRect(), x = b.left + b.width * 52 / 640;"
        " s.dispatchEvent(new MouseEvent('click', {clientX: x, clientY: b.top + 5})); }"
    )
    assert now() == pytest.approx(0, abs=0.02)
    tab.locator("body").press("v")
    assert now() == pytest.approx(first, abs=1e-3)
    tab.locator("body").press(".")
    assert now() == pytest.approx(first + 1 / 15, abs=1e-3)

    tab.evaluate("view.replay.speed = 0.01; view.seek(0)")
    tab.locator("[data-play]").click()
    tab.wait_for_function("() => view.now() > 0")
    tab.locator("[data-play]").click()
    assert tab.locator("[data-play]").inner_text() == "Play"
    assert all(url.startswith(("file:", "data:")) for url in asked)


def test_a_violating_body_turns_red_in_the_picture(pages, tab):
    tab.goto((pages / "unsafe.html").as_uri())
    [name] = {n for f in data(pages / "unsafe.html")["findings"] for n in f["bodies"][:1]}
    assert tab.evaluate(f"view.replay.tints[{name!r}]") == [0.95, 0.2, 0.1]
    tab.evaluate("view.seek(0)")
    assert tab.evaluate(f"view.replay.tints[{name!r}]") is None


def test_a_phone_does_not_scroll_sideways(pages, tab):
    tab.set_viewport_size(PHONE)
    tab.goto((pages / "unsafe.html").as_uri())
    assert tab.evaluate("document.documentElement.scrollWidth <= innerWidth")


def test_an_episode_without_rules_is_told(traces, tmp_path):
    from recordings import falling_cube

    falling_cube("alone").close(tmp_path / "alone.mcap")
    assert run("view", tmp_path / "alone.mcap", "-o", tmp_path / "p.html", "--no-open").code == 0
    assert "--bind" in (tmp_path / "p.html").read_text("utf-8")
