#!/usr/bin/env bash
# Brings requirements.lock up to date with pyproject.toml, keeping the pins that still fit.
# With --upgrade every pin moves to the newest version that fits.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

uv=$(command -v uv || true)
if [ -z "$uv" ]; then
    tools=$(mktemp -d)
    trap 'rm -rf "$tools"' EXIT
    .venv/bin/python -m venv "$tools"
    "$tools/bin/python" -m pip --disable-pip-version-check install --quiet uv
    uv=$tools/bin/uv
fi
# No address of a registry goes into the lock: each machine uses its own.
"$uv" pip compile pyproject.toml --group dev --universal --python-version 3.11 --generate-hashes \
    --no-emit-index-url --no-annotate --no-header --quiet --output-file requirements.lock "$@"
