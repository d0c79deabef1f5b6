"""Hostile rule files, bind files and map files."""

from __future__ import annotations

import json
import tomllib
from abc import ABC, abstractmethod
from dataclasses import replace
from pathlib import Path
from random import Random
from typing import Any, NamedTuple

from damage import damaged
from outcome import Outcome
from seeds import recorded
from strange import NAMES, altered

from safestage_eval.episode import Episode
from safestage_eval.episode.episode import with_header
from safestage_eval.errors import InputError
from safestage_eval.importers import MapFile, load_map
from safestage_eval.importers.map_file import MapErrors
from safestage_eval.rules import (
    BindFile,
    RuleErrors,
    RuleSet,
    load_bind,
    load_rules,
    rule_digest,
)
from safestage_eval.rules.files import builtin_folder
from safestage_eval.rules.uses import own_params
from safestage_eval.verdicts import judge

MAP = """
[source]
dt = "50 ms"
[every]
task = "Push"
roles = { target = ["cube"] }
[body.cube]
mass = 1.0
up = [0, 0, 1]
shapes = [{ kind = "box", size = [0.02, 0.02, 0.02] }]
[body.table]
kind = "fixture"
cavity = { kind = "box", size = [0.1, 0.1, 0.1] }
"""

LONG = {
    "rows": '[ruleset]\nformat = 1\nname = "x"\nversion = "1.0.0"\n'
    + "".join(f"[params.p{i}]\nvalue = 1\n" for i in range(3000)),
    "rules": '[ruleset]\nformat = 1\nname = "x"\nversion = "1.0.0"\nextends = ["defaults"]\n'
    + "".join(
        f'[[rule]]\ncode = "ETS{i % 1000:03}"\ntitle = "x"\nduring = "execution"\n'
        'roles = { a = "target" }\nforbid = { "displacement(a)" = "> 1 cm" }\nexplain = "{a}"\n'
        for i in range(300)
    ),
    "digits": "x = " + "1" * 10**6,
    "deep lists": "x = " + "[" * 10**5,
    "deep tables": "[" + ".".join("a" * 1 for _ in range(10**4)) + "]\n",
    "deep inline": "x = " + "{a=" * 2000 + "1" + "}" * 2000,
    "quotes": 'x = "' + "\\" * 10**5,
    "comments": "#" * 10**6,
    "spaces": " \n" * 10**5,
    "names": ".".join("a" * 50_000) + " = 1",
    "states": '[ruleset]\nformat = 1\nname = "x"\nversion = "1.0.0"\n'
    + "".join(
        f'[state.s{i}]\nof = ["a"]\nwhen = {{ "s{i + 1}(a)" = true }}\n' for i in range(2000)
    ),
    "keys": "\n".join(f"k{i} = {i}" for i in range(20_000)),
}

PATTERNS = (
    "a" * 20_000, "a(" * 5000, "from " + "a(b) to " * 2000, "first 1 s of " * 3000, "{" * 20_000,
    "at least 1 " * 3000, "a_" * 10_000 + "!", "1" * 20_000 + " cm", "start of " * 3000, "a, " * 20_000,
    "every object tagged " * 1000, " " * 50_000 + "x", "0." + "0" * 20_000 + "x",
)  # fmt: skip


class SoundText(NamedTuple):
    """A sound file: its bytes, what TOML makes of them, and what the program reads."""

    text: bytes
    tree: Any
    read: Any


class Text(ABC):
    """A file of ``kind`` with one thing in it that is not as it should be."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        path = folder / "input.toml"
        self.sound = []
        for text in self.seeds():
            path.write_text(text, "utf-8")
            self.sound.append(SoundText(text.encode(), tomllib.loads(text), self.load(path)))

    @abstractmethod
    def seeds(self) -> list[str]:
        """Sound files."""

    @abstractmethod
    def load(self, path: Path) -> Any:
        """Read one as the program does."""

    def run(self, rng: Random) -> Outcome:
        """One input."""
        sound = rng.choice(self.sound)
        data, what = self.made(rng, sound.text)
        path = self.folder / "input.toml"
        path.write_bytes(data)
        try:
            found = self.load(path)
        except (InputError, RuleErrors, MapErrors) as error:
            return Outcome("problem", what, str(error)[:300])
        return self.held(sound, tomllib.loads(data.decode("utf-8-sig")), found, what)

    def held(self, sound: SoundText, tree: Any, found: Any, what: str) -> Outcome:
        """Compare with the sound file: equal TOML is read as equal."""
        if repr(tree) != repr(sound.tree):
            return Outcome("lie", what)
        path = self.folder / "input.toml"  # what is read keeps where it was
        path.write_bytes(sound.text)
        return Outcome("same" if found == self.load(path) else "changed", what, "the same TOML")

    def made(self, rng: Random, data: bytes) -> tuple[bytes, str]:
        """The bytes of a file, and what was done."""
        act = rng.random()
        if act < 0.4:
            return damaged(rng, data, [i for i, c in enumerate(data) if c in b'\n"={[#'])
        if act < 0.41:
            name = rng.choice(list(LONG))
            return LONG[name].encode(), name
        tree = tomllib.loads(data.decode())
        if act < 0.55:
            return self.patterned(rng, tree)
        for _ in range(rng.choice((1, 1, 2, 5))):
            tree, what = altered(rng, tree)
        return written(tree), what

    def patterned(self, rng: Random, tree: Any) -> tuple[bytes, str]:
        """Texts on which a regular expression might try for ever."""
        pattern = rng.choice(PATTERNS)
        text = written(tree).decode()
        quotes = [i for i, c in enumerate(text) if c == '"']
        at = rng.choice(quotes) + 1
        return (text[:at] + pattern + text[at:]).encode(), f"{pattern[:20]!r} at {at}"


class Rules(Text):
    """Rule files."""

    name = "rule file"
    read_by = ()

    def seeds(self) -> list[str]:
        """Those that are built in."""
        return [(builtin_folder() / f"{n}.toml").read_text("utf-8") for n in ("ish", "ets", "fsh")]

    def load(self, path: Path) -> RuleSet:
        """Load like ``--rules``."""
        return load_rules([path])

    def held(self, sound: SoundText, tree: Any, found: RuleSet, what: str) -> Outcome:
        """Digests are those of what the rules say, and where they are the same, so is every verdict."""
        read: RuleSet = sound.read
        same, was = _digests(found), _digests(read)
        if repr(tree) == repr(sound.tree):
            return Outcome("same" if same == was else "changed", what, "the same TOML")
        rows = {str(row.get("code")): row for row in sound.tree.get("rule", ())}
        other = [
            row["code"]
            for row in tree.get("rule", ())
            if same[row["code"]] == was.get(row["code"])
            and repr(row) != repr(rows.get(row["code"]))
        ]  # said otherwise, and by its digest the same rule
        for code in other:
            for episode in recorded():
                truth, now = (_verdict(rules, code, episode) for rules in (read, found))
                if now != truth:
                    return Outcome("changed", what, f"{code} of the same digest: {truth} -> {now}")
        return Outcome("same" if same == was else "lie", what, ", ".join(other))


def _digests(rules: RuleSet) -> dict[str, str]:
    return {
        code: rule_digest(rules, rule, own_params(rules, rule))
        for code, rule in rules.rules.items()
    }


def _verdict(rules: RuleSet, code: str, episode: Episode) -> str:
    alone = replace(rules, rules={code: rules.rules[code]})
    header = episode.header.model_copy(update={"rules": (code,)})
    (found,) = judge(with_header(episode, header), alone, trace_hash="same").verdicts
    return found.verdict


class Bind(Text):
    """Bind files."""

    name = "bind file"
    read_by = ()

    def __init__(self, folder: Path) -> None:
        self.rules = load_rules(["ish", "ets", "fsh"])
        super().__init__(folder)

    def seeds(self) -> list[str]:
        """Some tasks of one that is built in, and an episode."""
        text = (builtin_folder() / "bind" / "robolab.toml").read_text("utf-8")
        tasks = tomllib.loads(text)
        few = {name: tasks["task"][name] for name in list(tasks["task"])[:3]}
        own = {"x/0": {"roles": {"target": ["cube"]}, "rules": ["ETS101"], "set": {"edge": "3 cm"}}}
        return [written({"task": few}).decode(), written({"episode": own}).decode()]

    def load(self, path: Path) -> BindFile:
        """Load like ``--bind``."""
        return load_bind(path, self.rules)


class Map(Text):
    """Map files of an import."""

    name = "map file"
    read_by = ("pydantic",)

    def seeds(self) -> list[str]:
        """One with every kind of table."""
        return [MAP]

    def load(self, path: Path) -> MapFile:
        """Load like ``--map``."""
        return load_map(path)


def written(tree: Any) -> bytes:
    """A table as TOML."""
    if not isinstance(tree, dict):
        return str(tree).encode("utf-8", "replace")
    lines = [f"{json.dumps(str(key))} = {inline(value)}" for key, value in tree.items()]
    return "\n".join(lines).encode("utf-8", "replace")


def inline(value: Any) -> str:
    """A value as inline TOML, or what is none."""
    if isinstance(value, dict):
        return (
            "{ " + ", ".join(f"{json.dumps(str(k))} = {inline(v)}" for k, v in value.items()) + " }"
        )
    if isinstance(value, list):
        return "[" + ", ".join(map(inline, value)) + "]"
    if value is None:
        return json.dumps(NAMES[3])  # TOML has no nothing
    return json.dumps(value, ensure_ascii=False) if not isinstance(value, float) else repr(value)
