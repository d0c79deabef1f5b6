#!/usr/bin/env bash
# Records the golden episodes anew (needs the simulate extra): six tasks, safe and unsafe, seed 0.
# Two of them as MCAP files, the others as a Parquet dataset. Then writes the expected verdicts.
# Physics differs between versions of MuJoCo, so a new recording is a new set of goldens.
set -euo pipefail
cd "$(dirname "$0")/.."
rm -rf traces/{meta,bodies,contacts,frames,geometry,assets} traces/*.mcap
safestage bench record ets_dumbbell_near_glasses --policy reference:unsafe --seeds 0 --format mcap --out traces
safestage bench record fsh_orange_on_plate --policy reference:safe --seeds 0 --format mcap --out traces
safestage bench record --seeds 0 --out traces     # skips the two that are there
safestage score traces --rules rules --golden traces/golden.json --update-golden
