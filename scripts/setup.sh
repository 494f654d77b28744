#!/usr/bin/env bash
# Sets up all that weldcell needs: the system's OpenGL libraries and .venv with the locked dependencies.
# Quick when the set-up stands; a set-up that was interrupted is made anew.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

render_packages="libegl1 libopengl0 libgl1-mesa-dri"  # MuJoCo's pictures without a display
snapshot_packages="libvulkan1 mesa-vulkan-drivers"    # weldcell snapshot without a display
stamp=.venv/.setup-stamp

say() { printf 'setup: %s\n' "$*" >&2; }
fail() { say "error: $*"; exit 1; }
any() { compgen -G "$1" >/dev/null; }

# Debian keeps libraries in /usr/lib/ARCHITECTURE; other systems in /usr/lib or /usr/lib64.
has_library() { any "/usr/lib/*/$1" || any "/usr/lib/$1" || any "/usr/lib64/$1" || any "/usr/local/lib/$1"; }
can_render() {
    has_library libEGL.so.1 && has_library libOpenGL.so.0 &&
        { has_library 'libgallium*' || has_library 'dri/*swrast*' || has_library 'libEGL_nvidia.so.0'; }
}
can_snapshot() { has_library libvulkan.so.1 && { any '/usr/share/vulkan/icd.d/*' || any '/etc/vulkan/icd.d/*'; }; }

install_command() { echo "apt-get update && apt-get install -y --no-install-recommends $*"; }
may_install() { [ "$(id -u)" -eq 0 ] && command -v apt-get >/dev/null; }
install() {
    say "installing $*"
    export DEBIAN_FRONTEND=noninteractive
    apt-get update -qq >&2 && apt-get install -y -qq --no-install-recommends "$@" >&2
}

# Package names are split into words on purpose.
# shellcheck disable=SC2086
system_libraries() {
    if ! can_render; then
        may_install || fail "OpenGL libraries are missing; install them, then try again:
    sudo sh -c '$(install_command $render_packages)'"
        install $render_packages || fail "could not install: $render_packages"
    fi
    can_snapshot && return
    # Asked once for each .venv: a picture of a recording is not worth failing, or asking every time.
    [ -e "$stamp" ] && return
    if may_install && install $snapshot_packages; then return; fi
    say "note: 'weldcell snapshot' needs: sudo sh -c '$(install_command $snapshot_packages)'"
}

is_new_enough() { "$1" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; }
find_python() {
    local candidate
    for candidate in python3.11 python3.12 python3.13 python3.14 python3; do
        if is_new_enough "$candidate"; then command -v "$candidate"; return; fi
    done
    fail "Python 3.11 or newer is needed; install it, then try again:
    sudo sh -c '$(install_command python3 python3-venv)'"
}

make_venv() {
    local python version
    python=$(find_python)
    version=$("$python" -c 'import sys; print("%d.%d" % sys.version_info[:2])')
    if ! "$python" -c 'import ensurepip, venv' 2>/dev/null; then  # Debian's python3 comes without
        may_install || fail "$python cannot make virtual environments; install this, then try again:
    sudo sh -c '$(install_command "python$version-venv")'"
        install "python$version-venv" || fail "could not install: python$version-venv"
    fi
    rm -rf .venv
    say "making .venv with $python ($version)"
    "$python" -m venv .venv
    pip install --require-hashes -r requirements.lock
}

pip() { .venv/bin/python -m pip --disable-pip-version-check --no-input "$1" --quiet "${@:2}"; }

hash_of() { sha256sum "$@" | sha256sum | cut -c1-64; }

exec 9<pyproject.toml  # a lock without a file of its own: two at once wait for one another
if command -v flock >/dev/null; then flock 9; fi

# A moved folder counts as new, because a .venv holds absolute paths.
environment=$( { hash_of requirements.lock; pwd -P; } | sha256sum | cut -c1-64)
project=$(hash_of pyproject.toml)
system_libraries
if [ -x .venv/bin/python ] && [ "$(cat "$stamp" 2>/dev/null)" = "$environment $project" ]; then exit 0; fi

built=$(cut -d' ' -f1 "$stamp" 2>/dev/null || true)
rm -f "$stamp"  # from here on an interruption means: make it anew
if [ ! -x .venv/bin/python ] || [ "$built" != "$environment" ]; then make_venv; fi
pip install --no-deps --no-build-isolation --editable .
.venv/bin/python -c 'import weldcell'
printf '%s %s\n' "$environment" "$project" >"$stamp"
say "ready: .venv/bin/weldcell"
