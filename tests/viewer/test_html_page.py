"""Pages: complete in themselves, with a policy that lets nothing else in."""

import re

from safestage_eval.palette import custom_properties
from safestage_eval.viewer.html_page import page, part


def test_every_token_that_is_used_exists():
    text = custom_properties() + part("theme.css")
    defined = set(re.findall(r"--([\w-]+):", text))
    assert set(re.findall(r"var\(--([\w-]+)\)", text)) <= defined


def test_a_page_names_its_scripts_and_styles_by_hash_and_allows_nothing_else():
    html = page("A <title>", ["<p>hello</p>"], styles=["p { color: red }"], scripts=["void 0;"])
    policy = re.search(r'Security-Policy" content="([^"]*)"', html)[1]
    assert "default-src &#x27;none&#x27;" in policy
    assert policy.count("sha256-") == 5
    assert "unsafe" not in policy
    assert "A &lt;title&gt;" in html
    assert not re.search(r'(?:src|href)="(?!data:)', html)
