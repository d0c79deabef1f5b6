"""The documentation site builds without a warning, and has what is written from code."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).resolve().parents[2]

pytest.importorskip("material", reason="the extra docs is not installed")


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The built site. Dead links and anchors, and pages in no menu, are warnings, and so errors."""
    folder = tmp_path_factory.mktemp("site")
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", folder],
        cwd=CHECKOUT,
        env={**os.environ, "NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return folder


@pytest.mark.slow
def test_every_command_has_its_section_and_the_search_finds_it(site):
    from safestage_eval.cli import HELP

    page = (site / "reference/commands/index.html").read_text("utf-8")
    assert [name for name in HELP if f'id="safestage-{name.replace(" ", "-")}"' not in page] == []
    assert "safestage-score" in (site / "search/search_index.json").read_text("utf-8")


@pytest.mark.slow
def test_every_code_leads_to_its_explanation(site):
    from safestage_eval.audit import choose
    from safestage_eval.rules import builtin_names, load_rules

    page = (site / "reference/messages/index.html").read_text("utf-8")
    for code in (*(one.code for one in choose()), *load_rules(builtin_names()).rules):
        assert f"<code>{code}</code></a>" in page


@pytest.mark.slow
def test_every_public_name_is_documented(site):
    import safestage_eval

    page = (site / "reference/python/index.html").read_text("utf-8")
    public = {*safestage_eval.__all__} - {"__version__"}
    assert [name for name in public if f'.{name}"' not in page] == []


@pytest.mark.slow
def test_pages_load_nothing_from_elsewhere(site):
    import re

    page = (site / "index.html").read_text("utf-8")
    loaded = re.findall(r'<(?:script|img|iframe)[^>]* src="([^"]+)"', page)
    loaded += re.findall(r'<link[^>]* rel="stylesheet"[^>]* href="([^"]+)"', page)
    assert loaded
    assert [one for one in loaded if "://" in one] == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("notebook", "shows"),
    [
        ("explore_scores", "data:image/png"),
        ("sweep_a_rule", "keep_off"),
        ("compare_policies", "difference"),
    ],
)
def test_notebooks_were_executed(site, notebook, shows):
    page = (site / "notebooks" / notebook / "index.html").read_text("utf-8")
    assert shows in page
    assert 'class="cell-output"' in page


def test_notebooks_are_kept_without_outputs():
    import json

    books = sorted((CHECKOUT / "docs" / "notebooks").glob("*.ipynb"))
    assert len(books) == 3
    for book in books:
        cells = json.loads(book.read_text("utf-8"))["cells"]
        assert [cell for cell in cells if cell.get("outputs")] == [], book.name
