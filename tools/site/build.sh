#!/usr/bin/env bash
# Builds the site into build/site; a warning, for example a dead link, is an error.
set -euo pipefail
cd "$(dirname "$0")/../.."
site=.cache/site
if ! cmp -s requirements-docs.lock "$site/installed"; then
  .venv/bin/python -m venv --clear "$site"
  "$site/bin/python" -m pip install --quiet --disable-pip-version-check -r requirements-docs.lock
  cp requirements-docs.lock "$site/installed"
fi
"$site/bin/python" -m sphinx -W --keep-going -q -b html -c tools/site -d build/site-doctrees \
  . build/site
echo "site: file://$PWD/build/site/README.html"
