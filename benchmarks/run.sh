#!/usr/bin/env bash
# Every benchmark of the project, one after the other; each prints ratios against a named peer.
# One that fails does not keep the others from running; the last lines name it.
set -uo pipefail
cd "$(dirname "$0")/.."
uptime
failed=()
for script in benchmarks/bench_*.py; do
  echo "== $script"
  .venv/bin/python "$script" || failed+=("$script")
done
uptime
if [ ${#failed[@]} -gt 0 ]; then
  echo "failed: ${failed[*]}" >&2
  exit 1
fi
