"""A real browser for the tests: Chromium without a screen.

Skipped where there is none; with SAFESTAGE_REQUIRE_BROWSER=1 that is a failure instead.
"""

import os
import shutil

import pytest

FLAGS = (
    "--no-sandbox", "--disable-gpu", "--enable-unsafe-swiftshader", "--disable-quic",
    "--no-first-run", "--disable-background-networking", "--disable-component-update",
    "--disable-sync",
)  # fmt: skip
"""No network of its own; 3-D drawn by the processor."""
LAPTOP, PHONE = {"width": 1366, "height": 768}, {"width": 390, "height": 844}


def _missing(what):
    if os.environ.get("SAFESTAGE_REQUIRE_BROWSER") == "1":
        pytest.fail(f"{what}, but SAFESTAGE_REQUIRE_BROWSER=1")
    pytest.skip(what)


@pytest.fixture(scope="module")
def browser():
    """Chromium, once per file."""
    path = next(
        filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
    )
    if path is None:
        _missing("no Chromium is installed")
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        _missing("playwright is not installed")
    with sync_playwright() as play:
        found = play.chromium.launch(executable_path=path, args=list(FLAGS))
        yield found
        found.close()


@pytest.fixture
def tab(browser):
    """A new page at a laptop's width; an error in its scripts fails the test."""
    context = browser.new_context(viewport=LAPTOP)
    page, errors = context.new_page(), []
    page.set_default_timeout(60_000)
    page.on("pageerror", lambda error: errors.append(str(error)))
    yield page
    context.close()
    assert not errors, errors
