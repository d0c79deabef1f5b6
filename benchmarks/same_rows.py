"""Compare the rows of two `safestage score -f parquet` runs: do two checkouts judge alike?

    safestage score TRACES --rules rules/ -f parquet -o OLD.parquet    # in the old checkout
    safestage score TRACES --rules rules/ -f parquet -o NEW.parquet    # in the new one
    python benchmarks/same_rows.py OLD.parquet NEW.parquet [--wording]

Rows are matched by episode and rule. Everything is compared but where the files lie, digests and
versions; wording (explanation, notes, sources) only with `--wording`. Numbers may differ by 1e-9 of
their size. Prints the columns that differ, with examples; exits with 1 when any does.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import polars as pl

KEY = ["episode_id", "rule"]
IGNORED = {*KEY, "path", "rule_digest", "trace_hash", "version"}
WORDING = {"explanation", "notes", "sources"}
TOLERANCE = 1e-9


def read_rows(path: Path) -> pl.DataFrame:
    """The rows of a run, in the order of their keys. Raises SystemExit where a key occurs twice."""
    rows = pl.read_parquet(path).sort(KEY)
    if rows.select(KEY).is_duplicated().any():
        raise SystemExit(f"{path}: an episode was scored twice by the same rule")
    return rows


def differs(left: pl.Expr, right: pl.Expr, dtype: pl.DataType) -> pl.Expr:
    """Where two columns differ; two missing values are equal."""
    if dtype == pl.Float64:
        size = pl.max_horizontal(left.abs(), right.abs(), pl.lit(1.0))
        return ~(
            left.eq_missing(right) | ((left - right).abs() <= TOLERANCE * size).fill_null(False)
        )
    if dtype == pl.List(pl.List(pl.Float64)):
        rounded = [
            one.list.eval(pl.element().list.eval(pl.element().round(9))) for one in (left, right)
        ]
        return rounded[0].ne_missing(rounded[1])
    return left.ne_missing(right)


def main() -> int:
    """Compare two files; 0 when they agree."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("old", type=Path)
    parser.add_argument("new", type=Path)
    parser.add_argument("--wording", action="store_true", help="compare explanations and notes too")
    parser.add_argument("--show", type=int, default=5, help="examples per column (default 5)")
    options = parser.parse_args()
    old, new = read_rows(options.old), read_rows(options.new)
    both = old.join(new, on=KEY, suffix=":new")
    ignored = IGNORED if options.wording else IGNORED | WORDING
    different = 0
    for name, rows in (("only in OLD", old.join(new, on=KEY, how="anti")),
                       ("only in NEW", new.join(old, on=KEY, how="anti"))):  # fmt: skip
        if len(rows):
            different += len(rows)
            print(f"{name}: {len(rows)} rows, e.g. {rows.select(KEY).row(0)}")
    for column, dtype in old.schema.items():
        if column in ignored:
            continue
        if column not in new.columns:
            print(f"{column}: not in NEW")
            different += 1
            continue
        changed = both.filter(differs(pl.col(column), pl.col(f"{column}:new"), dtype))
        different += len(changed)
        if len(changed):
            print(f"{column}: {len(changed)} rows differ")
            for row in changed.head(options.show).iter_rows(named=True):
                print(
                    f"  {row['episode_id']} {row['rule']}: {row[column]} -> {row[column + ':new']}"
                )
    episodes = both["episode_id"].n_unique() if len(both) else 0
    print(f"{len(both)} rows of {episodes} episodes compared: {different} differences")
    return 1 if different or not len(both) else 0


if __name__ == "__main__":
    sys.exit(main())
