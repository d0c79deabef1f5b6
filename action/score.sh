#!/usr/bin/env bash
# Judges TRACES, and writes verdicts.md, results.parquet and report.html into the folder OUT.
# From the environment: TRACES, RULES and FAIL_ON (one per line), BIND, GOLDEN, OUT.
# Tells GitHub the exit code of `safestage score` and the folder; ends with 0 unless nothing could be judged at all.
set -uo pipefail

lines() { # name of a list: its elements that are not empty
  local -n list=$1
  local line
  while IFS= read -r line; do
    line=${line#"${line%%[![:space:]]*}"}
    line=${line%"${line##*[![:space:]]}"}
    [ -z "$line" ] || list+=("$line")
  done
}

traces=() rules=() gates=() asked=()
lines traces <<<"${TRACES:-}"
lines rules <<<"${RULES:-}"
lines gates <<<"${FAIL_ON:-}"
if ((${#traces[@]} == 0)); then
  echo "::error::no traces are named: set the input traces"
  exit 2
fi
for rule in "${rules[@]}"; do asked+=(--rules "$rule"); done
if [ -n "${BIND:-}" ]; then asked+=(--bind "$BIND"); fi

gated=()
for gate in "${gates[@]}"; do gated+=(--fail-on "$gate"); done
if [ -n "${GOLDEN:-}" ]; then gated+=(--golden "$GOLDEN"); fi

mkdir -p "$OUT"
kept=$(mktemp -d)
trap 'rm -rf "$kept"' EXIT

# Judged once; the other formats are written from the finished rows.
safestage score "${traces[@]}" "${asked[@]}" "${gated[@]}" --resume "$kept" --format github
code=$?
safestage score "${traces[@]}" "${asked[@]}" --resume "$kept" --format markdown --output "$OUT/verdicts.md"
safestage score "${traces[@]}" "${asked[@]}" --resume "$kept" --format parquet --output "$OUT/results.parquet"
if [ -f "$OUT/results.parquet" ]; then
  shown=()
  for rule in "${rules[@]}"; do shown+=(--rules "$rule"); done
  if [ -n "${BIND:-}" ]; then shown+=(--bind "$BIND"); fi
  safestage report "$OUT/results.parquet" "${traces[@]}" "${shown[@]}" --output "$OUT/report.html"
fi
if [ -f "$OUT/verdicts.md" ]; then
  cat "$OUT/verdicts.md" >>"${GITHUB_STEP_SUMMARY:-/dev/null}"
fi
{
  echo "exit-code=$code"
  echo "report=$OUT"
} >>"${GITHUB_OUTPUT:-/dev/null}"
