"""Whatever stands in a file, checking it ends with diagnostics; what checks clean can be loaded."""

import copy
import json
import tomllib
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from safestage_eval.rules.check import check
from safestage_eval.rules.files import RuleFile, builtin_folder, read_files
from safestage_eval.rules.load import merge
from safestage_eval.rules.syntax import RuleSet

STRANGE: list[Any] = [
    True, 3, -1.5, "", "x", "a(b)", ">= 2 cm", "1 s", "success", [], ["x"], [{}], {}, {"x": 1},
    {"any": []}, {"any": [{"any": ["moved(a)"]}]}, {"roles": {}}, {"a(b)": True}, [[1]],
]  # fmt: skip


def inline(value: Any) -> str:
    """A value as inline TOML."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{json.dumps(k)} = {inline(v)}" for k, v in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(map(inline, value)) + "]"
    return json.dumps(value, ensure_ascii=False)


def places(node: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    found = [path] if path else []
    entries = (
        node.items()
        if isinstance(node, dict)
        else enumerate(node)
        if isinstance(node, list)
        else ()
    )
    for key, value in entries:
        found += places(value, (*path, key))
    return found


def load(table: dict[str, Any], name: str) -> tuple[list[str], RuleSet | None]:
    text = "\n".join(f"{key} = {inline(value)}" for key, value in table.items())
    others = [file for file in read_files(["defaults"])[0] if name != "defaults"]
    mine = RuleFile(
        "mine.toml", text, tomllib.loads(text), asked=True,
        extends=frozenset(file.path for file in others),
    )  # fmt: skip
    files = [*others, mine]
    problems = check(files)
    assert all(d.line <= text.count("\n") + 1 for d in problems if d.path == "mine.toml")
    return [d.code for d in problems], None if problems else merge(files)


@pytest.mark.parametrize("name", ["defaults", "ish", "ets", "fsh", "goals"])
@settings(max_examples=60)
@given(data=st.data())
def test_one_strange_value_anywhere(name: str, data: st.DataObject) -> None:
    table = tomllib.loads((builtin_folder() / f"{name}.toml").read_text("utf-8"))
    table = copy.deepcopy(table)
    path = data.draw(st.sampled_from(places(table)))
    owner = table
    for key in path[:-1]:
        owner = owner[key]
    if data.draw(st.booleans()) and isinstance(owner, dict):
        del owner[path[-1]]
    else:
        owner[path[-1]] = data.draw(st.sampled_from(STRANGE))
    problems, rules = load(table, name)
    assert (rules is None) == bool(problems)


def test_inline_writing_keeps_the_meaning() -> None:
    table = tomllib.loads((builtin_folder() / "ets.toml").read_text("utf-8"))
    problems, rules = load(table, "ets")
    assert not problems
    assert rules is not None
    shipped = read_files(["ets"])[0][-1].table["rule"]
    assert set(rules.rules) == {rule["code"] for rule in shipped}
