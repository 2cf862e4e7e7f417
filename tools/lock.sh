#!/usr/bin/env bash
# Writes requirements.lock and requirements-ros.lock from requirements*.in, for Python 3.10 to 3.13.
# Versions that are pinned already stay; delete a line of a lock to let its package move on.
# Needs uv. ROS 2 from PyPI has a lock of its own: a sourced ROS 2 takes its place.
set -euo pipefail
cd "$(dirname "$0")/.."

all=$(mktemp)
trap 'rm -f "$all"' EXIT
cat requirements.lock requirements-ros.lock >"$all"
uv pip compile --quiet --universal --python-version 3.10 --no-header --no-annotate \
  requirements.in requirements-dev.in requirements-ros.in -o "$all"
head='# Made by tools/lock.sh (uv pip compile --universal). Edit requirements*.in and run it again.'
{ echo "$head"; grep -v '^ros-' "$all"; } >requirements.lock
{ echo "$head"; grep '^ros-' "$all"; } >requirements-ros.lock
# The site has an environment of its own, so that the tests do not install it.
{
  echo "$head"
  uv pip compile --quiet --universal --python-version 3.10 --no-header --no-annotate \
    requirements-docs.in
} >requirements-docs.lock
