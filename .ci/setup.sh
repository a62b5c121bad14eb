#!/bin/sh
# Makes .venv ready for one extra of the distribution: sh .ci/setup.sh sim|dev|export|interop
# interop has .venv-interop to itself: MAVProxy brings an OpenCV that would overwrite the rover's.
# Says nothing and calls no pip when it is ready already. PYTHON=... chooses the interpreter.
set -eu

extra=${1:?give the extra to install: sim, dev, export or interop}
cd -- "$(dirname -- "$0")/.."
name=.venv
[ "$extra" != interop ] || name=.venv-interop
venv=$(pwd -P)/$name
log=$venv/setup.log
unfinished=$venv/.unfinished # stands while something is being changed: found at the start, it means "begin again"

# Inside an activated .venv, python3 is the very interpreter that may have to be replaced.
PATH=$(printf '%s' "$PATH" | tr ':' '\n' | grep -vxF "$venv/bin" | paste -sd: -)

fail() {
    printf 'set-up: %s\n' "$*" >&2
    exit 1
}

# Prints: version, new or old, bits, pip or no-pip, where it is installed.
examine() {
    "$1" -c '
import struct, sys
try:
    import ensurepip, venv
    pip = "pip"
except ImportError:
    pip = "no-pip"
age = "new" if sys.version_info >= (3, 10) else "old"
print("%d.%d.%d" % tuple(sys.version_info[:3]), age, 8 * struct.calcsize("P"), pip, sys.base_prefix)' 2>/dev/null
}

choose_python() {
    too_old=
    if [ -n "${PYTHON:-}" ]; then
        set -- "$PYTHON"
        examine "$PYTHON" >/dev/null ||
            fail "PYTHON=$PYTHON does not run: give the name or the path of a Python 3.10 or newer."
    else
        set -- python3 python3.13 python3.12 python3.11 python3.10
    fi
    for python; do
        facts=$(examine "$python") || continue
        read -r version age bits pip base <<FACTS
$facts
FACTS
        if [ "$age" = new ]; then
            check_python
            return
        fi
        too_old=${too_old:-"$python is $version"}
    done
    [ -z "$too_old" ] ||
        fail "$too_old, and Python 3.10 or newer is needed: install one, then type: make ${GOAL:-demo} PYTHON=/path/to/python3"
    fail "no Python found: type: sudo apt install python3 python3-venv"
}

check_python() {
    [ "$bits" = 64 ] ||
        fail "$python is a $bits-bit program and the packages exist for 64 bit only: install the 64-bit image of your system."
    [ "$pip" = pip ] || {
        [ "$python" = python3 ] && package=python3-venv || package=python${version%.*}-venv
        fail "$python cannot make virtual environments: type: sudo apt install $package"
    }
}

# Prints where .venv stands and whose interpreter it runs; nothing when that interpreter is gone.
venv_identity() {
    "$venv/bin/python" -c '
import sys
print(sys.prefix, sys.base_prefix, "%d.%d" % tuple(sys.version_info[:2]))' 2>/dev/null || true
}

identity=$(venv_identity)
stamp="$(cksum <pyproject.toml) $identity"

is_kept() {
    [ ! -e "$unfinished" ] || return 1
    case $identity in "$venv "*) ;; *) return 1 ;; esac
    for ready in "$venv"/.ready-*; do
        [ ! -e "$ready" ] || case $(cat "$ready") in *" $identity") ;; *) return 1 ;; esac
    done
    [ -z "${PYTHON:-}" ] || {
        choose_python
        [ "$identity" = "$venv $base ${version%.*}" ]
    }
}

explain_pip() {
    if grep -q 'No space left on device' "$log"; then
        fail "the disk is full: free about 1 GB and type it again. The log: $log"
    elif grep -qE 'NewConnectionError|NameResolutionError|ConnectTimeout|ProxyError|Network is unreachable' "$log"; then
        fail "pip cannot reach its package index: check the network (and any proxy) and type it again. The log: $log"
    fi
    reason=$(grep -iE '^ *error' "$log" | tail -n 1)
    fail "pip could not install the packages (${reason:-it gave no reason}); type it again. The log: $log"
}

if is_kept; then
    [ "$(cat "$venv/.ready-$extra" 2>/dev/null)" != "$stamp" ] || exit 0
    printf 'set-up: bringing %s up to date for %s (log: %s/setup.log)\n' "$name" "$extra" "$name"
    : >"$unfinished"
else
    choose_python
    printf 'set-up: making %s with Python %s for %s, once (log: %s/setup.log)\n' "$name" "$version" "$extra" "$name"
    rm -rf "$venv"
    mkdir "$venv"
    : >"$unfinished"
    "$python" -m venv "$venv" >"$log" 2>&1 ||
        fail "$python could not make $name: $(tail -n 1 "$log") The log: $log"
    stamp="$(cksum <pyproject.toml) $(venv_identity)"
fi

# Without a network, pip's own five retries take over a minute to say so.
PIP_RETRIES=${PIP_RETRIES:-3} "$venv/bin/python" -m pip install --no-user --no-input --disable-pip-version-check -e ".[$extra]" \
    >"$log" 2>&1 </dev/null || {
    # Where pip only failed to download, .venv is what it was: an earlier set-up stays usable offline.
    grep -q '^ *Installing collected packages' "$log" || rm -f "$unfinished"
    explain_pip
}

# dev contains sim.
case $extra in dev) printf '%s\n' "$stamp" >"$venv/.ready-sim" ;; esac
printf '%s\n' "$stamp" >"$venv/.ready-$extra"
rm -f "$unfinished"
echo 'set-up: ready'
