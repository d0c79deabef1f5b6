"""A reviewer's sitting, in a real browser."""

import csv
import io

import numpy as np
import pytest
from browser import PHONE
from films import COLOURS, film
from PIL import Image
from sitting import SECRETS, record, served, session


@pytest.fixture(scope="module")
def traces(tmp_path_factory):
    return record(tmp_path_factory.mktemp("traces"))


@pytest.fixture
def server(traces, tmp_path):
    with served(
        session(traces, tmp_path / "labels.csv", commands=("safestage label agreement …",))
    ) as found:
        yield found


def answers(server):
    """(rollout, label, reviewer, note) of every line of the file."""
    place = {ref.episode_id: i for i, ref in enumerate(server.session.refs)}
    path = server.session.ledger.path
    if not path.exists():
        return []
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    return [(place[r["episode_id"]], r["label"], r["reviewer"], r["note"]) for r in rows]


def come(tab, server, name="ada"):
    tab.emulate_media(reduced_motion="reduce")  # nothing moves unasked
    tab.goto(server.url)
    tab.get_by_label("Name or initials").fill(name)
    tab.keyboard.press("Enter")


def at(tab, number):
    """Wait until a rollout is shown, its picture too."""
    tab.wait_for_selector(f'#app[data-shown="{number}"]', state="attached")


def shot(tab, place="#screen"):
    """(N, 3) colours of what is seen there."""
    picture = Image.open(io.BytesIO(tab.locator(place).screenshot())).convert("RGB")
    return np.asarray(picture).reshape(-1, 3)


def test_a_sitting_by_keyboard_is_saved_key_by_key_and_goes_on_after_a_reload(tab, server):
    tab.emulate_media(reduced_motion="reduce")
    listed = []
    tab.on("response", lambda response: listed.append(response.body()) if response.ok else None)
    come(tab, server)
    at(tab, 0)
    first = server.session.item(0)
    assert tab.locator("#task").inner_text() == first["instruction"]
    assert "Keep the cup off the vase." in tab.locator("#requirement").inner_text()
    assert "protected: vase" in tab.locator("#requirement").inner_text()
    assert len(np.unique(shot(tab), axis=0)) > 20
    tab.keyboard.press("s")
    at(tab, 1)
    assert answers(server) == [(0, "safe", "ada", "")]
    tab.reload()
    at(tab, 1)
    assert tab.locator("#count").inner_text() == "1 of 3 answered"
    tab.keyboard.press("n")
    tab.keyboard.type("sux: it slides")
    assert len(answers(server)) == 1
    tab.keyboard.press("Escape")
    tab.keyboard.press("u")
    at(tab, 2)
    assert answers(server)[1:] == [(1, "unsafe", "ada", "sux: it slides")]
    tab.keyboard.press("PageUp")
    at(tab, 1)
    assert tab.get_by_label("Note").input_value() == "sux: it slides"
    assert tab.get_by_role("button", pressed=True, name="Unsafe").count() == 1
    tab.keyboard.press("PageDown")
    at(tab, 2)
    tab.keyboard.press("x")
    tab.get_by_role("heading", name="All answered").wait_for()
    assert "safestage label agreement" in tab.locator("#commands").inner_text()
    assert "1 safe, 1 unsafe, 1 unsure" in tab.locator("#summary").inner_text()
    assert [answer[:2] for answer in answers(server)] == [(0, "safe"), (1, "unsafe"), (2, "unsure")]
    whole = b"".join(listed)
    assert len(whole) > 10_000
    for secret in (*SECRETS, "SECRET-FILE", "came too close"):
        assert secret.encode() not in whole


def test_a_video_beside_the_trace_is_shown_first_and_plays(traces, tab, tmp_path):
    sitting = session(traces, tmp_path / "labels.csv", videos=tmp_path)
    film(tmp_path / f"{sitting.refs[0].path.stem}.mp4")
    with served(sitting) as server:
        come(tab, server)
        video = tab.locator("video")
        video.wait_for()
        tab.wait_for_function("() => document.querySelector('video').readyState >= 2")
        assert video.evaluate("v => [v.videoWidth, v.videoHeight]") == [320, 180]
        assert video.evaluate("v => v.duration") == pytest.approx(3, abs=0.1)
        for second, colour in enumerate(COLOURS):
            if second:
                tab.keyboard.press("ArrowRight")  # a second on
            tab.wait_for_function(
                "s => { const v = document.querySelector('video');"
                " return !v.seeking && Math.abs(v.currentTime - s) < 0.1; }",
                arg=second,
            )
            shown = np.median(shot(tab, "video"), axis=0)
            assert np.abs(shown - colour).max() < 40
        tab.keyboard.press("ArrowLeft")
        tab.keyboard.press("Space")
        tab.wait_for_function("() => document.querySelector('video').ended")  # it plays to its end
        tab.get_by_role("button", name="Show in 3-D").click()
        tab.locator("canvas").first.wait_for()
        assert not video.is_visible()
        tab.keyboard.press("s")
        at(tab, 1)
        assert answers(server) == [(0, "safe", "ada", "")]
        assert not video.is_visible()  # the second has none


def test_a_note_that_is_added_later_is_kept(tab, server):
    come(tab, server)
    at(tab, 0)
    tab.keyboard.press("s")
    at(tab, 1)
    tab.keyboard.press("PageUp")
    at(tab, 0)
    tab.get_by_label("Note").fill("seen twice")
    tab.keyboard.press("Escape")
    tab.wait_for_function("() => document.querySelector('#said').textContent === 'Note saved.'")
    assert answers(server) == [(0, "safe", "ada", ""), (0, "safe", "ada", "seen twice")]


def test_every_control_has_a_name_and_a_phone_has_room(tab, server):
    tab.set_viewport_size(PHONE)
    come(tab, server)
    at(tab, 0)
    nameless = tab.evaluate(
        """() => [...document.querySelectorAll("button, input, select, textarea, video, canvas")]
            .filter((x) => !(x.innerText || x.ariaLabel || x.labels?.length)).map((x) => x.outerHTML)"""
    )
    assert nameless == []
    width = tab.evaluate("document.documentElement.scrollWidth")
    assert width == PHONE["width"]
    for name in ("safe", "unsafe", "unsure"):
        box = tab.locator(f'[data-answer="{name}"]').bounding_box()
        assert box["y"] + box["height"] <= PHONE["height"]
        assert min(box["width"], box["height"]) >= 44
