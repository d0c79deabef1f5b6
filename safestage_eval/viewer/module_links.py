"""ES modules of the package as one script, so that a page works from a disk, where browsers load no modules.

A module says what it takes and gives in the plainest way: ``import { a, b } from "./other.js";`` and
``export`` before a function, class or constant. Names at the top of modules are unique among those
that one script links; nothing is renamed.
"""

from __future__ import annotations

import re
from functools import cache
from importlib.resources import files

_IMPORT = re.compile(r'^import \{([^}]*)\} from "\./([\w-]+\.js)";\n', re.MULTILINE)
_TOP = re.compile(r"^(export )?(?:async )?(?:function\*?|class|const|let) (\w+)", re.MULTILINE)


@cache
def linked(entry: str, package: str = "safestage_eval.viewer.browser") -> str:
    """Write a module and all that it imports, those first, as one script in a scope of its own.

    Raises ValueError for modules that cannot be linked.
    """
    texts: dict[str, str] = {}
    given: dict[str, set[str]] = {}
    owner: dict[str, str] = {}

    def visit(name: str, asked: tuple[str, ...]) -> None:
        if name in asked:
            raise ValueError(f"{' → '.join((*asked, name))}: a circle of imports")
        if name in texts:
            return
        text = files(package).joinpath(name).read_text("utf-8")
        for names, other in _IMPORT.findall(text):
            visit(other, (*asked, name))
            for wanted in filter(None, map(str.strip, names.split(","))):
                if wanted not in given[other]:
                    raise ValueError(f"{name}: {other} exports no {wanted!r}")
        text = _IMPORT.sub("", text)
        if re.search(r"^(import|export (?!(async )?function|class|const|let))", text, re.MULTILINE):
            raise ValueError(f"{name}: an import or export of another form than the linker knows")
        declared = _TOP.findall(text)
        for _, top in declared:
            if top in owner:
                raise ValueError(f"{top!r} stands at the top of {owner[top]} and of {name}")
            owner[top] = name
        given[name] = {top for exported, top in declared if exported}
        texts[name] = re.sub(r"^export ", "", text, flags=re.MULTILINE)

    visit(entry, ())
    return '(() => {\n"use strict";\n' + "\n".join(texts.values()) + "})();\n"
