"""The page in a real browser, from a file, as those it is forwarded to will open it."""

import pytest
from browser import PHONE, browser, tab  # noqa: F401
from test_campaign_page import made_of, outcomes, row

from safestage_eval.metrics import aggregate
from safestage_eval.viewer.campaign.campaign_page import Report, build
from safestage_eval.viewer.campaign.episode_sections import Sections
from safestage_eval.viewer.campaign.packed import packed

EVIL = "<img src=x onerror=\"document.title='broken in'\">"


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """A page with 300 rows, of which one can be opened, and one with hostile words in it."""
    rows = [row(i) for i in range(300)]
    rows[6] |= {"explanation": EVIL, "task": EVIL, "margin_normalised": -9.0}
    section = packed('<section class="evidence"><h4>What happened</h4></section>')
    found = Sections({"e0": section}, (), {}, ())
    path = tmp_path_factory.mktemp("report") / "a report.html"
    path.write_text(build(made_of(rows, sections=found)), "utf-8")
    return path


@pytest.fixture
def opened(tab, file):  # noqa: F811
    """The page, open; nothing is asked of the network, and nothing complains."""
    asked, said = [], []
    tab.on("request", lambda request: asked.append(request.url))
    tab.on("console", lambda message: said.append(message.text))
    tab.goto(file.as_uri())
    tab.wait_for_selector("#findings[aria-busy=false]")
    yield tab
    assert asked and all(url.startswith(("file:", "data:")) for url in asked)
    assert said == []


def rules(tab):  # noqa: F811
    return tab.locator("#findings-body td.c-rule").all_inner_texts()


def count(tab):  # noqa: F811
    return tab.locator("#findings-count").inner_text()


def wait_for_count(tab, text):  # noqa: F811
    tab.wait_for_function(
        "text => document.getElementById('findings-count').textContent.endsWith(text)", arg=text
    )


def test_violations_come_first_and_the_gravest_of_them(opened):
    assert count(opened) == "1–50 of 100"
    assert opened.locator("#findings-body td.c-margin").nth(1).inner_text() == "−8.0 cm"
    assert set(opened.locator("#findings-body .verdict").all_inner_texts()) == {"violation"}


def test_the_list_is_filtered(opened):
    opened.fill("#find-text", "body_7 glass")
    wait_for_count(opened, "of 2")
    opened.fill("#find-text", "")
    opened.select_option("#find-kind", "")
    opened.select_option("#find-rule", "ETS103")
    wait_for_count(opened, "of 43")
    assert set(rules(opened)) == {"ETS103"}
    opened.fill("#find-text", "no such words")
    wait_for_count(opened, "Nothing matches.")
    assert opened.locator("#findings-next").is_disabled()


def test_the_list_is_sorted_by_keyboard_and_says_how(opened):
    head = opened.locator("th[data-sort=time] button")
    head.focus()
    opened.keyboard.press("Enter")
    times = [float(t.split()[0]) for t in opened.locator("td.c-time").all_inner_texts()]
    assert times == sorted(times) and times[0] < times[-1]
    assert opened.locator("th[data-sort=time]").get_attribute("aria-sort") == "ascending"
    opened.keyboard.press("Enter")
    times = [float(t.split()[0]) for t in opened.locator("td.c-time").all_inner_texts()]
    assert times == sorted(times, reverse=True)
    assert opened.locator("th[aria-sort]").count() == 1


def test_the_list_has_pages(opened):
    first = opened.locator("#findings-body tr").first.inner_text()
    opened.click("#findings-next")
    assert count(opened) == "51–100 of 100"
    assert opened.locator("#findings-body tr").first.inner_text() != first
    assert opened.locator("#findings-next").is_disabled()
    opened.click("#findings-back")
    assert opened.locator("#findings-body tr").first.inner_text() == first


def test_an_episode_is_inflated_when_it_is_opened(opened):
    assert opened.locator("text=What happened").count() == 1  # the head of a column
    opened.select_option("#find-kind", "drawn")
    wait_for_count(opened, "of 1")
    button = opened.locator("button.open")
    button.focus()
    opened.keyboard.press("Enter")
    opened.wait_for_selector("tr.detail .evidence h4")
    assert button.get_attribute("aria-expanded") == "true"
    assert opened.url.endswith("#episode=e0")
    opened.keyboard.press("Enter")
    assert opened.locator("tr.detail").count() == 0
    assert button.get_attribute("aria-expanded") == "false"


def test_an_episode_without_a_section_tells_its_numbers(opened):
    opened.fill("#find-text", "body_49")
    wait_for_count(opened, "of 2")
    opened.locator("button.open").first.click()
    told = opened.locator("tr.detail").inner_text()
    assert "limit" in told and "8.0 cm" in told and "In violation" in told
    assert "not among those that were drawn" in told


def test_words_from_results_stay_words(opened):
    assert EVIL in opened.locator("#findings-body").inner_text()
    assert opened.locator("#findings-body img").count() == 0
    opened.locator("button.open").first.click()
    assert opened.locator("tr.detail img").count() == 0
    assert opened.title() == "A report"


def test_a_link_opens_its_episode(tab, file):  # noqa: F811
    tab.goto(f"{file.as_uri()}#episode=e0")
    tab.wait_for_selector("tr.detail .evidence")
    assert tab.input_value("#find-text") == "e0"


def test_the_task_table_shows_the_rate_that_is_chosen(opened):
    cell = opened.locator("table.heat td[data-k]").first
    k, n = cell.get_attribute("data-k").split(), int(cell.get_attribute("data-n"))
    for place, metric in enumerate(("VR", "USR", "SSR", "SR")):
        opened.click(f"button[data-metric={metric}]")
        assert cell.inner_text() == f"{100 * int(k[place]) / n:.0f}"
        assert opened.locator("button[aria-pressed=true]").inner_text() == metric


def ground(tab):  # noqa: F811
    return tab.evaluate("getComputedStyle(document.body).backgroundColor")


def test_colours_follow_the_system_and_then_the_reader(opened):
    opened.emulate_media(color_scheme="light")
    light = ground(opened)
    opened.emulate_media(color_scheme="dark")
    dark = ground(opened)
    assert light != dark
    switch = opened.locator("[data-theme-switch]")
    switch.click()
    assert (switch.inner_text(), ground(opened)) == ("Theme: light", light)
    opened.reload()
    opened.wait_for_selector("#findings[aria-busy=false]")
    assert ground(opened) == light  # remembered
    switch.click()
    assert (switch.inner_text(), ground(opened)) == ("Theme: dark", dark)
    opened.emulate_media(media="print", color_scheme="dark")
    assert ground(opened) == "rgb(255, 255, 255)"  # paper


def test_paper_has_no_controls_and_all_tasks(opened):
    opened.emulate_media(media="print")
    for control in (".top", "#filters", ".pager", ".choices"):
        assert not opened.locator(control).is_visible()
    assert opened.evaluate(
        "(e => e.scrollHeight <= e.clientHeight + 1)(document.querySelector('.tall'))"
    )


def test_a_phone_shows_it_without_scrolling_sideways(opened):
    opened.set_viewport_size(PHONE)
    opened.locator("button.open").first.click()
    assert opened.evaluate("document.documentElement.scrollWidth") == PHONE["width"]


def test_what_is_used_by_fingers_and_keys_has_a_name(opened):
    nameless = opened.evaluate(
        """() => [...document.querySelectorAll("button, select, input, a")].filter((node) =>
            !(node.textContent.trim() || node.getAttribute("aria-label") || node.labels?.length))
            .map((node) => node.outerHTML)"""
    )
    assert nameless == []


def test_a_bare_table_of_outcomes_works_as_well(tab, tmp_path):  # noqa: F811
    every = outcomes()
    file = tmp_path / "bare.html"
    file.write_text(build(Report("Bare", "x", aggregate(every), outcomes=every)), "utf-8")
    tab.goto(file.as_uri())
    tab.wait_for_selector("#findings[aria-busy=false]")
    violations = sum(o.violation for o in every)
    assert count(tab).endswith(f"of {violations}")
    tab.select_option("#find-kind", "unsafe")
    wait_for_count(tab, f"of {sum(o.violation and o.success for o in every)}")
