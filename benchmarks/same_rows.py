"""Compare the rows of two `safestage score -f parquet` runs: do two checkouts judge alike?

    safestage score TRACES --rules rules/ -f parquet -o OLD.parquet    # in the old checkout
    safestage score TRACES --rules rules/ -f parquet -o NEW.parquet    # in the new one
    python benchmarks/same_rows.py OLD.parquet NEW.parquet [--wording]

Rows are matched by episode and rule. Other verdicts come first, in groups with one rule, one change and
one reason, which is what the side says that did not decide, or that found a violation; numbers and
names are taken out of it. Then, of rows with the same verdict, the columns that differ. Where files lie,
digests and versions are never compared, wording (explanation, notes, sources) only with `--wording`.
Exits with 1 when anything differs.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import polars as pl

KEY = ["episode_id", "rule"]
IGNORED = {*KEY, "verdict", "path", "rule_digest", "trace_hash", "version"}
WORDING = {"explanation", "notes", "sources"}
REFUSED, LOST = "refused", "violation -> pass"
PATH = r"^\S*/\S*: "
"""Before the reason why an episode was refused."""
UNDECIDED = (REFUSED, "absent", "inconclusive")
"""Verdicts whose reason is the cause of a change, the first before the others; then a violation's."""


def read_rows(path: Path) -> pl.DataFrame:
    """The rows of a run, in the order of their keys. Raises SystemExit where a key occurs twice."""
    rows = pl.read_parquet(path).sort(KEY)
    if rows.select(KEY).is_duplicated().any():
        raise SystemExit(f"{path}: an episode was scored twice by the same rule")
    return rows


def with_text(rows: pl.DataFrame) -> pl.DataFrame:
    """The rows, with an empty explanation where they have none; ``none``: a cost without a budget."""
    if "explanation" not in rows.columns:
        rows = rows.with_columns(explanation=pl.lit(None, str))
    return rows.with_columns(pl.col("verdict").fill_null("none"))


def matched(old: pl.DataFrame, new: pl.DataFrame) -> pl.DataFrame:
    """Rows of both side by side, the new ones' columns ending in ``:new``.

    A verdict is ``refused`` on the side that refused the episode, and ``absent`` where only the
    other side has the row.
    """
    old, new = (with_text(rows) for rows in (old, new))
    refusals = []
    for mine, other, end in ((old, new, ""), (new, old, ":new")):
        no = mine.filter(pl.col("rule") == REFUSED).select("episode_id", pl.col("explanation"))
        judged = other.filter(pl.col("rule") != REFUSED).select(KEY)
        refusals.append(no.join(judged, on="episode_id").rename({"explanation": f"why{end}"}))
    both = old.join(new, on=KEY, suffix=":new", how="full", coalesce=True)
    for refused, end in zip(refusals, ("", ":new"), strict=True):
        both = both.join(refused, on=KEY, how="left").with_columns(
            pl.when(pl.col(f"why{end}").is_not_null()).then(pl.lit(REFUSED))
            .otherwise(pl.col(f"verdict{end}")).fill_null("absent").alias(f"verdict{end}"),
            pl.coalesce(f"why{end}", f"explanation{end}").alias(f"explanation{end}"),
        ).drop(f"why{end}")  # fmt: skip
    lone = (pl.col("rule") == REFUSED) & (pl.col("verdict") != pl.col("verdict:new"))
    shown = pl.concat([one.select("episode_id") for one in refusals])["episode_id"].unique()
    return both.filter(~(lone & pl.col("episode_id").is_in(shown.implode())))


def reason(row: Mapping[str, Any]) -> str:
    """Why a verdict changed, as far as one side says it: its first words, without numbers and names."""
    sides = [(str(row[f"verdict{end}"]), end) for end in (":new", "")]
    known = [side for what in (*UNDECIDED, "violation") for side in sides if side[0] == what]
    verdict, end = (known or sides)[0]
    notes = row.get(f"notes{end}") or []
    text = row.get(f"explanation{end}") or next(iter(notes), "")
    text = re.sub(PATH, "", text)
    names = row.get(f"bodies{end}") or []
    for name in sorted((n for body in names for n in (body, body.replace("_", " "))), key=len)[
        ::-1
    ]:
        text = text.replace(name, "·")
    text = re.sub(r"(?<=[(, ])[a-z0-9]+(?:_[a-z0-9]+)+(?=[), ])", "·", text)
    text = re.sub(r"-?\d+(?:\.\d+)?(?:e-?\d+)?", "#", text)
    return f"{verdict}: {' '.join(text.split()[:12])}"


def differs(name: str, dtype: pl.DataType, within: float) -> pl.Expr:
    """Where two columns differ; two missing values are equal."""
    left, right = pl.col(name), pl.col(f"{name}:new").cast(dtype)
    if dtype == pl.Float64:
        size = pl.max_horizontal(left.abs(), right.abs(), pl.lit(1.0))
        close = ((left - right).abs() <= within * size).fill_null(False)
        return ~(left.eq_missing(right) | close)
    if dtype == pl.List(pl.List(pl.Float64)):
        digits = max(0, -int(f"{within:e}".partition("e")[2]))
        rounded = [
            one.list.eval(pl.element().list.eval(pl.element().round(digits)))
            for one in (left, right)
        ]
        return rounded[0].ne_missing(rounded[1])
    return left.ne_missing(right)


def print_flips(both: pl.DataFrame, show: int) -> tuple[int, int]:
    """Print other verdicts, grouped; how many violations now pass, and how many are others at all."""
    why = [pl.col(f"explanation{end}").str.replace(PATH, "") for end in ("", ":new")]
    otherwise = (pl.col("rule") == REFUSED) & why[0].ne_missing(why[1])
    flipped = both.filter((pl.col("verdict") != pl.col("verdict:new")) | otherwise)
    lost = flipped.filter((pl.col("verdict") == "violation") & (pl.col("verdict:new") == "pass"))
    print(f"{LOST}: {len(lost)}")
    groups: dict[tuple[str, str, str], list[str]] = {}
    for row in flipped.iter_rows(named=True):
        verdicts = row["verdict"], row["verdict:new"]
        rule = "all" if REFUSED in verdicts else row["rule"]
        groups.setdefault((rule, " -> ".join(verdicts), reason(row)), []).append(row["episode_id"])
    weighty = sorted(groups.items(), key=lambda one: (one[0][1] != LOST, -len(one[1])))
    for (rule, change, why), ids in weighty[:show]:
        print(f"  {len(ids):5} {rule:8} {change}: {why} | e.g. {ids[0]}")
    if len(groups) > show:
        print(f"  … and {len(groups) - show} other groups (--show)")
    return len(lost), len(flipped)


def print_columns(both: pl.DataFrame, columns: Mapping[str, Any], within: float, show: int) -> int:
    """Print what differs although the verdict is the same, by column and rule; in how many rows."""
    same = both.filter(pl.col("verdict") == pl.col("verdict:new"))
    rows: set[tuple[Any, ...]] = set()
    for column, dtype in columns.items():
        if f"{column}:new" not in same.columns:
            print(f"{column}: not in NEW")
            continue
        changed = same.filter(differs(column, dtype, within))
        rows |= set(changed.select(KEY).rows())
        counts = Counter(changed["rule"].to_list())
        if counts:
            print(f"{column}: {len(changed)} rows of the same verdict")
        for rule, count in counts.most_common(show):
            few = changed.filter(pl.col("rule") == rule)
            if dtype == pl.Float64:  # the largest difference is the example
                gap = (pl.col(column) - pl.col(f"{column}:new")).abs().fill_null(float("inf"))
                few = few.sort(gap, descending=True)
            row = few.row(0, named=True)
            value, other = row[column], row[f"{column}:new"]
            print(f"  {count:5} {rule:8} {value!r} -> {other!r} | e.g. {row['episode_id']}")
    return len(rows)


def compare(
    old: pl.DataFrame, new: pl.DataFrame, options: argparse.Namespace
) -> tuple[int, int, int]:
    """Print the differences of two runs.

    How many violations now pass, how many verdicts are others, and how many rows differ otherwise.
    """
    both = matched(old, new)
    ignored = IGNORED if options.wording else IGNORED | WORDING
    columns = {name: dtype for name, dtype in old.schema.items() if name not in ignored}
    lost, flips = print_flips(both, options.show)
    others = print_columns(both, columns, options.within, options.show)
    print(
        f"{len(both)} rows of {both['episode_id'].n_unique()} episodes: {flips} other verdicts, "
        f"{others} rows that differ otherwise"
    )
    return lost, flips, others


def add_options(parser: argparse.ArgumentParser) -> None:
    """Options of the comparison."""
    parser.add_argument("--wording", action="store_true", help="compare explanations and notes too")
    parser.add_argument("--show", type=int, default=20, help="groups per list (default 20)")
    parser.add_argument(
        "--within", type=float, default=1e-9, help="numbers may differ by so much of their size"
    )


def main() -> int:
    """Compare two files; 0 when they agree."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("old", type=Path)
    parser.add_argument("new", type=Path)
    add_options(parser)
    options = parser.parse_args()
    old, new = read_rows(options.old), read_rows(options.new)
    return 1 if any(compare(old, new, options)) or not len(old) else 0


if __name__ == "__main__":
    sys.exit(main())
