"""Other benchmarks' own code beside our rules, on the same traces and synthetic crossings.

    python benchmarks/peers/compare.py --checkouts DIR --traces refs/ noisy/ --out counts.json
    python benchmarks/peers/compare.py --counts *.json --page docs/peers.md

DIR holds a checkout per benchmark, named like its repository (RoboLab, oopsieverse, …); the commits
are those that the rules' ``source`` names; VLA-Arena calls ``check_contact`` of robosuite 1.5, so that
one is wanted too (``robosuite``). A checkout that is missing is left out. ``--first`` and ``--every``
run a share, in pieces whose counts are added up. ``--page`` writes the tables into the page.
"""

from __future__ import annotations

import argparse
import importlib
import json
import sys
from collections import Counter
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parents[1] / "tests" / "helpers")]

from peer_code import defines  # noqa: E402
from tally import Count, Tally  # noqa: E402

PEERS = {
    "robolab": "RoboLab",
    "oopsieverse": "oopsieverse",
    "safevla": "SafeVLA",
    "vla_arena": "VLA-Arena",
    "safelibero": "vlsa-aegis",
    "is_bench": "IS-Bench",
    "safety_gymnasium": "safety-gymnasium",
    "maniguard": "ManiGuard",
}
"""Module here → name of the checkout."""

FILES = {"vla_arena": "libero_safety"}
"""Module here → rule file, where the names differ."""

READ_ONLY = {
    "safemanip": "compared by reading only",
    "safevla_bench": "its formulas are not published",
    "iso_ts_15066": "a standard: there is no code",
}
"""Rule files of which no peer's code is run, and why."""

BEGIN, END = "<!-- counts: benchmarks/peers/compare.py -->", "<!-- end of counts -->"


def main() -> None:
    """See the module."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--checkouts", type=Path, help="folder with a checkout per benchmark")
    options.add_argument("--traces", type=Path, nargs="*", default=[], help="folders of traces")
    options.add_argument("--peers", nargs="*", default=list(PEERS), choices=list(PEERS))
    options.add_argument("--every", type=int, default=1, help="every so manieth trace")
    options.add_argument(
        "--examples", action="store_true", help="the examples of the rules as well"
    )
    options.add_argument("--first", type=int, default=0, help="how many traces to leave out first")
    options.add_argument("--out", type=Path, help="where to write the counts, as JSON")
    options.add_argument("--counts", type=Path, nargs="*", default=[], help="counts to add up")
    options.add_argument("--page", type=Path, help="page whose table is written anew")
    given = options.parse_args()
    tallies = {peer: Tally() for peer in PEERS}
    for path in given.counts:
        for peer, counts in json.loads(path.read_text("utf-8")).items():
            tallies[peer].add(read(counts["counts"]))
            tallies[peer].ran += Counter(counts["ran"])
    if given.checkouts:
        for peer in given.peers:
            if (given.checkouts / PEERS[peer]).is_dir():
                compare(peer, given, tallies)
    for peer, tally in tallies.items():
        for row in tally.rows():
            print(peer, *row, sep=" | ")
    if given.page:
        text = given.page.read_text("utf-8")
        head, _, rest = text.partition(BEGIN)
        given.page.write_text(
            f"{head}{BEGIN}\n{page(tallies)}{END}{rest.partition(END)[2]}", "utf-8"
        )


def compare(peer: str, given: argparse.Namespace, tallies: dict[str, Tally]) -> None:
    """Run one peer's code on all traces; counts are written after every tenth."""
    from safestage_eval.formats import discover
    from safestage_eval.sketch import resolve

    with importlib.import_module(peer).comparing(given.checkouts / PEERS[peer]) as judge:
        if not given.first:  # of several pieces the first one alone does what needs no trace
            judge(None, tallies[peer])
            sources(peer, given.checkouts, tallies[peer])
        if given.examples and peer != "is_bench":
            for name, folder in examples(peer):
                judge(resolve(name, [folder]), tallies[peer])
                tallies[peer].ran["examples"] += 1
        refs = [(f.name, ref) for f in given.traces for ref in discover([f])]
        refs = [] if peer == "is_bench" else refs[given.first :: given.every]
        for number, (folder, ref) in enumerate(refs, 1):
            judge(ref.open(), tallies[peer])
            tallies[peer].ran[folder] += 1
            if given.out and (number % 10 == 0 or number == len(refs)):
                write(given.out, tallies)
                print(f"{peer}: {number} of {len(refs)}", file=sys.stderr, flush=True)
    if given.out:
        write(given.out, tallies)


def examples(peer: str) -> list[tuple[str, Path]]:
    """The scenes at known crossings: every example of the peer's rules, once."""
    from safestage_eval.rules import load_rules

    rules = load_rules([FILES.get(peer, peer)]).scoped.values()
    named = {
        name: Path(rule.path).parent / "examples"
        for rule in rules
        for name in (*rule.violates, *rule.passes)
    }
    return sorted(named.items())


def sources(peer: str, checkouts: Path, tally: Tally) -> None:
    """Every rule's source is in the checkout: the file, and the function in it."""
    from safestage_eval.rules import load_rules

    for rule in load_rules([FILES.get(peer, peer)]).scoped.values():
        for source in rule.source.split("; "):
            repository, file, name = (*source.partition(", ")[0].split(" ", 2), "")[:3]
            folder = checkouts / repository.partition("@")[0].partition("/")[2]
            if folder.is_dir():
                one = tally.count("source of each rule", repository, "names")
                one.run += 1
                one.agreed += defines(folder / file, name)


def write(path: Path, tallies: dict[str, Tally]) -> None:
    """Counts as JSON."""
    values = {
        peer: {
            "ran": dict(tally.ran),
            "counts": [
                [*key, c.run, c.agreed, dict(c.differences)] for key, c in tally.counts.items()
            ],
        }
        for peer, tally in tallies.items()
        if tally.counts
    }
    path.write_text(json.dumps(values, indent=1), "utf-8")


def read(counts: list[list[object]]) -> Tally:
    """Counts from JSON."""
    found = Tally()
    for ours, theirs, unit, run, agreed, differences in counts:
        found.counts[str(ours), str(theirs), str(unit)] = Count(run, agreed, Counter(differences))  # type: ignore[arg-type, call-overload]
    return found


def page(tallies: dict[str, Tally]) -> str:
    """The tables of the page: what ran, what agreed, and what was not compared.

    Raises SystemExit for a rule that neither was compared nor says why it was not.
    """
    folders = sorted({name for tally in tallies.values() for name in tally.ran} - {"examples"})
    lines = [
        "",
        f"| beside | {' | '.join(folders)} | examples |",
        "|---" * (len(folders) + 2) + "|",
    ]
    for peer, tally in tallies.items():
        ran = [f"{tally.ran[name]:,}" for name in (*folders, "examples")]
        lines.append(f"| {PEERS[peer]} | {' | '.join(ran)} |")
    lines += ["", "| here | there | compared | agreed | differences |", "|---|---|---|---|---|"]
    for tally in tallies.values():
        lines += [f"| {' | '.join(row)} |" for row in tally.rows()]
    lines += ["", "| not compared | why |", "|---|---|"]
    for peer, tally in tallies.items():
        lines += [f"| {code} | {why} |" for code, why in left_out(peer, tally).items()]
    lines += [f"| all of `{name}` | {why} |" for name, why in READ_ONLY.items()]
    return "\n".join([*lines, "", ""])


def left_out(peer: str, tally: Tally) -> dict[str, str]:
    """Rules of a file that were not compared, and why. Raises SystemExit where that is not said."""
    from safestage_eval.rules import load_rules

    module = importlib.import_module(peer)
    reasons, named = getattr(module, "NOT_COMPARED", {}), getattr(module, "COMPARED_AS", {})
    done = " ".join(ours for ours, _, _ in tally.counts)
    codes = load_rules([FILES.get(peer, peer)]).scoped
    open_ = [code for code in codes if code not in done and named.get(code, code) not in done]
    silent = [code for code in open_ if code not in reasons]
    if silent:
        raise SystemExit(f"{peer}: neither compared nor said why: {', '.join(silent)}")
    return {code: reasons[code] for code in open_}


if __name__ == "__main__":
    main()
