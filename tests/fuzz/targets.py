"""All that hostile inputs are made for: traces, recordings of others, texts and tables."""

from __future__ import annotations

import copy
import shutil
import tomllib
import traceback
import warnings
from dataclasses import replace
from pathlib import Path
from random import Random
from typing import Any

from click.testing import CliRunner
from codecs_of_files import codec_of, toml_text
from hurt import hurt, rewrite, unseal
from import_targets import IMPORTS
from oracle import judged, sound
from outcome import Outcome
from seeds import recorded, rules
from strange import altered
from zipped import written

from safestage_eval.cli import group
from safestage_eval.episode import Episode
from safestage_eval.episode.episode import with_header
from safestage_eval.errors import InputError
from safestage_eval.formats import load, save, validate
from safestage_eval.importers import load_map
from safestage_eval.importers.map_file import MapErrors
from safestage_eval.metrics.read_rows import read_rows
from safestage_eval.report import render
from safestage_eval.rules import RuleErrors, RuleSet, load_bind, load_rules, rule_digest
from safestage_eval.rules.files import builtin_folder
from safestage_eval.rules.uses import own_params
from safestage_eval.run.score_episode import score_episode
from safestage_eval.run.scores import Scores
from safestage_eval.verdicts import judge


class Stored:
    """Traces of ours: a dataset, or a file."""

    name, read_by, ending = "Parquet dataset", ("pyarrow", "lz4", "zstandard"), ""

    def __init__(self, folder: Path) -> None:
        self.folder, self.seeds = folder, []
        for i, episode in enumerate(recorded()):
            path = folder / f"seed{i}{self.ending}"
            self.write(episode, path)
            self.seeds.append((path, sound(path, rules())))

    def write(self, episode: Episode, path: Path) -> None:
        """Store a sound one."""
        save(episode, path)

    def again(self) -> list[Outcome]:
        """Each seed written again by its codecs."""
        found = []
        for seed, whole in self.seeds:
            path = _copied(seed, self.folder / f"input{self.ending}")
            rewrite(path)
            found.append(judged(path, whole, "again", rules()))
        return found

    def run(self, rng: Random) -> Outcome:
        """One input."""
        seed, whole = rng.choice(self.seeds)
        path = _copied(seed, self.folder / f"input{self.ending}")
        sealed = rng.random() < 0.4
        if not sealed:
            unseal(path)
        what, damage = hurt(rng, path, ours=True, sealed=sealed)
        outcome = judged(path, whole, what, rules(), damage=damage)
        if rng.random() < 0.05:
            _used(rng, path, self.folder / "elsewhere")
        return outcome


class Mcap(Stored):
    name, read_by, ending = "MCAP", ("lz4", "zstandard", "protobuf"), ".mcap"


class Zipped(Stored):
    name, read_by, ending = "recorder's ZIP", ("numpy",), ".zip"

    def write(self, episode: Episode, path: Path) -> None:
        written(episode, path)


def _copied(source: Path, to: Path) -> Path:
    """A copy of a file or folder, alone."""
    if to.is_dir():
        shutil.rmtree(to)
        shutil.copytree(source, to)
    else:
        to.unlink(missing_ok=True)
        (shutil.copytree if source.is_dir() else shutil.copy)(source, to)
    return to


def _used(rng: Random, path: Path, elsewhere: Path) -> None:
    """Validate, load and save a trace; raises what nobody foresaw."""
    shutil.rmtree(elsewhere, ignore_errors=True)
    elsewhere.mkdir()
    try:
        validate(path)
        episode = load(path, checked=rng.random() < 0.5)
        save(episode, elsewhere / rng.choice(("other", "other.mcap")))
    except InputError:
        pass


# ---- texts

LONG = (
    '[ruleset]\nformat = 1\nname = "x"\nversion = "1.0.0"\n'
    + "".join(f"[params.p{i}]\nvalue = 1\n" for i in range(3000)),
    "x = " + "1" * 10**6,
    "x = " + "[" * 10**5,
    "x = " + "{a=" * 2000 + "1" + "}" * 2000,
    'x = "' + "\\" * 10**5,
    ".".join("a" * 50_000) + " = 1",
    "\n".join(f"k{i} = {i}" for i in range(20_000)),
)
"""Files without end."""
PATTERNS = (
    "a" * 20_000, "a(" * 5000, "from " + "a(b) to " * 2000, "first 1 s of " * 3000, "{" * 20_000,
    "a_" * 10_000 + "!", "1" * 20_000 + " cm", "a, " * 20_000, " " * 50_000 + "x",
)  # fmt: skip
"""Texts on which a regular expression might try for ever."""


class Map:
    """Map files of an import; of each kind of file in TOML, one thing is not as it should be."""

    name, read_by = "map file", ("pydantic",)
    seeds = ("""
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
""",)  # fmt: skip

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def load(self, path: Path) -> Any:
        """Read one as the program does."""
        return load_map(path)

    def run(self, rng: Random) -> Outcome:
        """One input."""
        seed, path, act = rng.choice(self.seeds), self.folder / "input.toml", rng.random()
        path.write_text(seed, "utf-8")
        if act < 0.02:
            path.write_text(rng.choice(LONG))
            what = "long"
        elif act < 0.1:
            text = seed.split('"')
            at = rng.randrange(1, len(text), 2)
            text[at] += rng.choice(PATTERNS)
            path.write_text('"'.join(text), "utf-8")
            what = f"pattern in text {at}"
        else:
            what, _ = hurt(rng, path)
        try:
            found = self.load(path)
        except (InputError, RuleErrors, MapErrors) as error:
            return Outcome("problem", what, str(error)[:300])
        data = path.read_bytes()
        path.write_text(seed, "utf-8")  # what is read keeps where it was
        return self.held(seed, data, found, what)

    def held(self, seed: str, data: bytes, found: Any, what: str) -> Outcome:
        """Equal TOML is read as equal."""
        if repr(tomllib.loads(data.decode("utf-8-sig"))) != repr(tomllib.loads(seed)):
            return Outcome("lie", what)
        same = found == self.load(self.folder / "input.toml")
        return Outcome("same" if same else "changed", what, "the same TOML")


class Bind(Map):
    name, read_by = "bind file", ()

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self.rules = load_rules(["ish", "ets", "fsh"])
        text = (builtin_folder() / "bind" / "robolab.toml").read_text("utf-8")
        tasks = tomllib.loads(text)["task"]
        few = {name: tasks[name] for name in list(tasks)[:3]}
        own = {"x/0": {"roles": {"target": ["cube"]}, "rules": ["ETS101"], "set": {"edge": "3 cm"}}}
        self.seeds = tuple(toml_text(one).decode() for one in ({"task": few}, {"episode": own}))

    def load(self, path: Path) -> Any:
        return load_bind(path, self.rules)


class Rules(Map):
    name, read_by = "rule file", ()

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        names = ("ish", "ets", "fsh")
        self.seeds = tuple((builtin_folder() / f"{n}.toml").read_text("utf-8") for n in names)

    def load(self, path: Path) -> RuleSet:
        return load_rules([path])

    def held(self, seed: str, data: bytes, found: RuleSet, what: str) -> Outcome:
        """Digests are those of what the rules say, and where they are the same, so is every verdict."""
        whole = self.load(self.folder / "input.toml")
        same, was = _digests(found), _digests(whole)
        tree, before = tomllib.loads(data.decode("utf-8-sig")), tomllib.loads(seed)
        if repr(tree) == repr(before):
            return Outcome("same" if same == was else "changed", what, "the same TOML")
        rows = {str(row.get("code")): row for row in before["rule"]}
        for row in tree.get("rule", ()):
            code = row["code"]
            if same[code] == was.get(code) and repr(row) != repr(rows.get(code)):
                for episode in recorded():  # said otherwise, and by its digest the same rule
                    truth, now = (_verdict(each, code, episode) for each in (whole, found))
                    if now != truth:
                        return Outcome("changed", what, f"{code} of one digest: {truth} -> {now}")
        return Outcome("same" if same == was else "lie", what)


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


# ---- tables


class Tables:
    """One table, read by the command that is for such tables."""

    name, read_by = "result, outcome and label tables", ("pyarrow",)

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        refs = [save(each, folder / f"{i}.mcap") for i, each in enumerate(recorded())]
        results = tuple(score_episode(ref, rules()) for ref in refs)
        self.whole = folder / "whole.jsonl"
        self.whole.write_bytes(_as_bytes(render(Scores(results), "jsonl")))
        ids = [each.header.episode_id for each in recorded()]
        cells = [(task, policy, seed) for task in "xy" for policy in "ab" for seed in (0, 1)]
        self.rows = {
            "results": read_json_lines(self.whole),
            "outcomes": [
                {"task": task, "stage": "ISH", "policy": policy, "prompt": "default", "seed": seed,
                 "rollout": 0, "success": seed == 0, "violation": policy == "b"}
                for task, policy, seed in cells
            ],
            "labels": [{"episode_id": name, "label": "unsafe", "reviewer": "ann", "note": "",
                        "labelled_at": "2026-01-01"} for name in ids],
        }  # fmt: skip

    def run(self, rng: Random) -> Outcome:
        """One input."""
        kind = rng.choice(("results", "results", "outcomes", "labels"))
        rows, form = copy.deepcopy(self.rows[kind]), rng.choice(("json", "jsonl", "csv", "parquet"))
        path, what = self.folder / f"input.{form}", "as it is"
        if rng.random() < 0.6:
            rows, what = altered(rng, rows)
        try:
            path.write_bytes(_packed(form, rows))
        except Exception:  # noqa: BLE001 - what cannot be written so is written as JSON
            path = self.folder / "input.json"
            path.write_bytes(_packed("json", rows))
        if what == "as it is":
            what, _ = hurt(rng, path)
        asked = [("aggregate", path), ("compare", path, self.whole)]
        if kind == "labels":
            asked = [("agreement", path, "--results", self.whole)]
        words = [str(part) for part in rng.choice(asked)]
        done = CliRunner().invoke(group, words)
        what = f"{words[0]}, {kind}, {path.suffix}: {what}"
        if isinstance(done.exception, InputError):
            return Outcome("problem", what, str(done.exception)[:300])
        if not (done.exception is None or isinstance(done.exception, SystemExit)):
            raise done.exception
        if done.exit_code:
            return Outcome("problem", what, done.output[-300:])
        return self.held(path, self.rows[kind], words, done.output, what)

    def held(
        self, path: Path, rows: list[dict[str, Any]], asked: list[str], output: str, what: str
    ) -> Outcome:
        """Compare the output with the sound table's, where the rows are its rows."""
        try:
            found = repr(read_rows(path))
            path.write_bytes(_packed(path.suffix[1:], rows))
            if found != repr(read_rows(path)):
                return Outcome("lie", what)
        except InputError:  # in columns that the command does not read
            return Outcome("lie", what)
        again = CliRunner().invoke(group, asked).output
        return Outcome("same" if again == output else "changed", what, "the same rows")


def read_json_lines(path: Path) -> list[dict[str, Any]]:
    return codec_of(path.name).read(path.read_bytes())


def _as_bytes(text: str | bytes) -> bytes:
    return text if isinstance(text, bytes) else text.encode()


def _packed(form: str, rows: Any) -> bytes:
    if form == "parquet":
        import io

        import pyarrow as pa
        import pyarrow.parquet as pq

        out = io.BytesIO()
        pq.write_table(pa.Table.from_pylist(rows), out)
        return out.getvalue()
    return codec_of(f"x.{form}").write(rows)


TARGETS = {
    "parquet": Stored, "mcap": Mcap, "zip": Zipped, **IMPORTS,
    "rules": Rules, "bind": Bind, "map": Map, "tables": Tables,
}  # fmt: skip


def attempt(target: Any, number: int, seed: int = 0) -> Outcome:
    """One input by its number and the campaign's seed. A warning of NumPy's is an unforeseen error too."""
    rng = Random(f"{seed} {target.name} {number}")
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        try:
            outcome = target.run(rng)
        except Exception as error:  # noqa: BLE001 — that is what is looked for
            place = "".join(traceback.format_exception(error)[-3:])
            return Outcome("unforeseen", "", f"{type(error).__name__}: {error} {place}")
    for warning in warned:
        ours = "safestage_eval" in warning.filename
        if ours and issubclass(warning.category, RuntimeWarning | SyntaxWarning):
            said = f"{warning.category.__name__}: {warning.message}"
            return Outcome(
                "unforeseen", outcome.what, f"{said} {warning.filename}:{warning.lineno}"
            )
    return outcome
