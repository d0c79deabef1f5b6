"""The what-if table against judging again: agreement, what it leaves open, and how long both take.

    python benchmarks/what_if.py agree FOLDER… [--draws 4] [--every 1] [--seed 0]
    python benchmarks/what_if.py cost FOLDER… [--every 1]
    python benchmarks/what_if.py times ROWS.parquet [--episodes 34920]

``agree`` draws random values of every parameter that the assigned rules read, and judges each
episode again under each value that its table decides; a difference makes the exit code 1. ``cost``
gives the processor time of judging an episode, opened anew, and of its table. ``times`` repeats the rows of a run, which ``safestage score --what-if all`` wrote, to as many episodes, and
answers one other value and a sweep of 200 from them.
"""

from __future__ import annotations

import argparse
import random
import statistics
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

import polars as pl

from safestage_eval.formats import discover
from safestage_eval.rules import load_rules
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.digest import parameters_read
from safestage_eval.rules.syntax import amount
from safestage_eval.verdicts import judge
from safestage_eval.verdicts.verdict import at_risk
from safestage_eval.whatif.flip_query import verdicts_under
from safestage_eval.whatif.flip_sweep import sweep_table
from safestage_eval.whatif.flip_table import SUFFIX, FlipTable, episode_rows, moves_success
from safestage_eval.whatif.flips import Piece, pieces_of
from safestage_eval.whatif.judge_again import Again
from safestage_eval.whatif.swept_values import between, like


def drawn(usual: float, rng: random.Random, *, whole: bool) -> float:
    """A value around the usual one: up to twice as large, or of another size altogether."""
    size = rng.choice([rng.uniform(0, 2), rng.lognormvariate(0, 1)]) * (abs(usual) or 1.0)
    return float(round(size)) if whole else size


def compare(
    again: Again, draws: int, rng: random.Random
) -> Iterator[tuple[str, str, float, bool | None]]:
    """(rule, parameter, value, whether table and judging agree; None where the table is open)."""
    for rule in again.assigned:
        players = again.binding.players(rule, again.episode.header)
        if not all(players.values()) or isinstance(rule, ast.Cost):
            continue
        base, _ = again.base(rule)
        for param in sorted(parameters_read(again.rules, rule)):
            usual = base.params[param]
            pieces = [] if moves_success(again, param) else pieces_of(base, rule, players, param)
            whole = isinstance(usual, ast.Duration) and usual.frames
            for _ in range(draws):
                value = drawn(amount(usual), rng, whole=whole)
                predicted = piece_at(pieces, value)
                if predicted is None or predicted.verdict is None:
                    yield rule.code, param, value, None
                    continue
                now = again.under(base, rule, {param: like(usual, value)})
                risk = at_risk(now.verdict, now.instances, now.vacuity)
                same = (now.verdict, risk) == (predicted.verdict, predicted.at_risk)
                yield rule.code, param, value, same


def piece_at(pieces: Sequence[Piece], value: float) -> Piece | None:
    """The piece that a value is in."""
    found = [piece for piece in pieces if piece.low <= value < piece.high]
    assert len(found) <= 1, f"{value} is in {len(found)} pieces"
    return found[0] if found else None


def agree(folders: Sequence[str], draws: int, every: int, seed: int) -> int:
    """Print how often table and judging agree; the number of differences."""
    rules, rng = load_rules(["ish", "ets", "fsh", "goals"]), random.Random(seed)
    asked, undecided, wrong, episodes = Counter[str](), Counter[str](), 0, 0
    for ref in discover(list(folders))[::every]:
        again, episodes = Again(ref.open(), rules), episodes + 1
        for rule, param, value, same in compare(again, draws, rng):
            asked[param] += 1
            undecided[param] += same is None
            if same is False:
                wrong += 1
                print(f"DIFFERENT {ref.episode_id} {rule} {param} = {value!r}", flush=True)
    total, left = asked.total(), undecided.total()
    for param in sorted(asked):
        print(
            f"{param:16} {asked[param]:6} values  {undecided[param] / asked[param]:7.2%} undecided"
        )
    print(
        f"{episodes} episodes, {total} values: {total - left} decided, {wrong} of them different; "
        f"{left / total:.2%} undecided"
    )
    return wrong


def cost(folders: Sequence[str], every: int) -> None:
    """Print the processor time of judging, and of the table of all parameters, by stage."""
    rules = load_rules(["ish", "ets", "fsh", "goals"])
    refs = discover(list(folders))[::every]
    asked = partial(episode_rows, rules=rules, overrides={}, bind=None, params=None)
    for ref in refs:  # scenes are met, kernels loaded
        judge(ref.open(), rules, assigned_only=True)
    spent: dict[str, list[tuple[float, float]]] = {}
    for ref in refs:
        start = time.process_time()
        found = judge(ref.open(), rules, assigned_only=True)
        judged = time.process_time()
        asked(ref)
        spent.setdefault(found.stage or "–", []).append(
            (judged - start, time.process_time() - judged)
        )
    for stage, pairs in sorted(spent.items()):
        one, other = (1e3 * statistics.mean(side) for side in zip(*pairs, strict=True))
        print(
            f"{stage}: {len(pairs)} episodes, judging {one:.0f} ms, the table {other:.0f} ms each"
        )


def times(path: str, episodes: int) -> None:
    """Print how long other values take over so many episodes."""
    rows, pieces = pl.read_parquet(path), pl.read_parquet(FlipTable(path).beside)
    meta = pl.read_parquet_metadata(FlipTable(path).beside)
    copies = -(-episodes // rows["episode_id"].n_unique())
    with tempfile.TemporaryDirectory() as folder:
        many = Path(folder) / "rows.parquet"
        _repeated(rows, copies).write_parquet(many)
        _repeated(pieces, copies).sort("param", "episode_id", "rule", "low").write_parquet(
            many.with_name(many.stem + SUFFIX), metadata={"safestage": meta["safestage"]},
            row_group_size=20_000, compression="zstd",
        )  # fmt: skip
        del rows, pieces
        start = time.perf_counter()
        table = FlipTable(many)
        print(f"{table.rows['episode_id'].n_unique()} episodes; rows read in {_since(start)}")
        rules = load_rules(list(table.judging.rules))
        for param in ("edge", "min_clearance", "still", "hold_time", "contact_force"):
            start = time.perf_counter()
            other = like(rules.params[param], 1.5 * amount(rules.params[param]))
            found = verdicts_under(FlipTable(many), {param: other})
            left = int(found["undecided"].sum())
            flipped = int((found["verdict"] != found["new"]).sum())
            one = _since(start)
            start = time.perf_counter()
            swept = sweep_table(
                FlipTable(many), param, between(rules, param, None, None, 200), judge_again=False
            )
            swept.curves()
            print(
                f"{param:16} one value {one} ({flipped} flipped, {left} undecided); 200 values, with "
                f"their rates {_since(start)} ({swept.undecided} of {swept.count} undecided)"
            )


def _repeated(frame: pl.DataFrame, copies: int) -> pl.DataFrame:
    return pl.concat(
        frame.with_columns(pl.format("{}#{}", "episode_id", pl.lit(n)).alias("episode_id"))
        for n in range(copies)
    )


def _since(start: float) -> str:
    return f"{time.perf_counter() - start:.2f} s"


def main() -> int:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    one = commands.add_parser("agree")
    one.add_argument("folders", nargs="+")
    one.add_argument("--draws", type=int, default=4)
    one.add_argument("--every", type=int, default=1)
    one.add_argument("--seed", type=int, default=0)
    spent = commands.add_parser("cost")
    spent.add_argument("folders", nargs="+")
    spent.add_argument("--every", type=int, default=1)
    other = commands.add_parser("times")
    other.add_argument("rows")
    other.add_argument("--episodes", type=int, default=34_920)
    args = parser.parse_args()
    if args.command == "agree":
        return int(agree(args.folders, args.draws, args.every, args.seed) > 0)
    if args.command == "cost":
        cost(args.folders, args.every)
    else:
        times(args.rows, args.episodes)
    return 0


if __name__ == "__main__":
    sys.exit(main())
