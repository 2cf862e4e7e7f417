#!/usr/bin/env bash
# Every benchmark of the project, one after the other; each prints ratios against a named peer.
set -euo pipefail
cd "$(dirname "$0")/.."
for script in benchmarks/bench_*.py; do
  echo "== $script"
  .venv/bin/python "$script"
done
