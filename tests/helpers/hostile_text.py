"""Text of strangers, and what may be left of it where a person reads."""

import unicodedata

EVIL = (
    '=HYPERLINK("http://evil")<script>alert(1)</script><img src=x onerror=alert(1)>\\<b>'
    "\x1b]0;owned\x07\x1b[2J\x9b31m\u202egnp.exe\u2066\u200b[click](javascript:1)![p](http://e/p.png)"
    "&lt;i&gt;\r\n::error::owned|`x`"
)


def shows_all(text: str) -> bool:
    """Whether nothing in a text moves the cursor, turns the line or cannot be seen."""
    hidden = {"Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"}
    return not {unicodedata.category(c) for c in text.replace("\n", "").replace("\t", "")} & hidden
