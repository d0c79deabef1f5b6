"""Modules become one script without a change of what they say."""

from importlib.resources import files

import pytest

from safestage_eval.viewer import module_links
from safestage_eval.viewer.module_links import linked


@pytest.fixture
def link(tmp_path, monkeypatch):
    def of(**modules):
        for name, text in modules.items():
            (tmp_path / f"{name}.js").write_text(text)
        monkeypatch.setattr(module_links, "files", lambda package: tmp_path)
        linked.cache_clear()
        return linked("main.js")

    yield of
    linked.cache_clear()


def test_what_is_imported_comes_first_and_once(link):
    text = link(
        main='import { b } from "./b.js";\nimport { a } from "./a.js";\nb(a);\n',
        b='import { a } from "./a.js";\nexport function b() { return a; }\n',
        a="export const a = 1;\n",
    )
    assert text.index("const a = 1") < text.index("function b()") < text.index("b(a)")
    assert text.count("const a = 1") == 1
    assert "import" not in text and "export" not in text


@pytest.mark.parametrize(
    ("modules", "said"),
    [
        ({"main": 'import { a } from "./a.js";\n', "a": "const a = 1;\n"}, "exports no 'a'"),
        ({"main": 'import { a } from "./a.js";\nconst b = 1;\n', "a": "const b = 2;\nexport const a = 1;\n"}, "at the top of"),
        ({"main": 'import { a } from "./a.js";\nexport const b = 1;\n', "a": 'import { b } from "./main.js";\nexport const a = 1;\n'}, "circle"),
        ({"main": 'import * as a from "./a.js";\n', "a": "export const a = 1;\n"}, "another form"),
        ({"main": "export default 3;\n"}, "another form"),
    ],
)  # fmt: skip
def test_what_cannot_be_linked_is_refused(link, modules, said):
    with pytest.raises(ValueError, match=said):
        link(**modules)


def test_every_module_of_the_browser_is_one_and_is_used():
    folder = files("safestage_eval.viewer.browser")
    text = "".join(linked(entry) for entry in ("replay_global.js", "main.js"))
    for module in folder.iterdir():
        if module.name.endswith(".js"):
            first = module.read_text("utf-8").splitlines()[0]
            assert first.startswith("// ")  # what it is for
            assert first in text, module.name
