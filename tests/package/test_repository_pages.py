"""Links of pages on the documentation site."""

import re
import sys
from pathlib import Path

DOCS = Path(__file__).resolve().parents[2] / "docs"
sys.path.insert(0, str(DOCS / "site"))

from repository_pages import keep_inside  # noqa: E402


def test_a_link_that_names_a_file_names_its_page():
    text = "See [rules.md](rules.md#digest) and [the rules](rules.md)."
    assert (
        keep_inside(text, "cli.md", DOCS)
        == "See [Writing rules](rules.md#digest) and [the rules](rules.md)."
    )
    assert keep_inside("[rules.md](../rules.md)", "import/map.md", DOCS) == (
        "[Writing rules](../rules.md)"
    )


def test_a_link_out_of_the_site_becomes_the_path_and_a_dead_one_stays():
    assert keep_inside("[the code](../recorder)", "cli.md", DOCS) == "the code (`recorder`)"
    assert keep_inside("[recorder](../recorder)", "cli.md", DOCS) == "`recorder`"
    for dead in ("[gone](../gone.md)", "[gone.md](gone.md)", "![a picture](images/gone.svg)"):
        assert keep_inside(dead, "cli.md", DOCS) == dead


def test_no_page_shows_the_name_of_a_file_as_a_link():
    for page in DOCS.rglob("*.md"):
        shown = keep_inside(page.read_text("utf-8"), page.relative_to(DOCS).as_posix(), DOCS)
        assert re.findall(r"\[[\w/]+\.md\]\((?!https?:)", shown) == [], page.name
