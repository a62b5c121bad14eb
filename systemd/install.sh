#!/bin/sh
# Installs the companion as a service of this rover: sudo sh systemd/install.sh [SOURCE]
#
# SOURCE is what pip installs: a checkout (default: the one this file is in), a wheel or a requirement.
# Run it again to update: the program and the unit are replaced; files in /etc/anytraverse are not.
# DESTDIR=folder is for packagers: the files go there, no user is created and systemctl is not called.
set -eu
umask 022

here=$(cd -- "$(dirname -- "$0")" && pwd -P)
destination=${DESTDIR:-}
python=${PYTHON:-/usr/bin/python3}
venv=$destination/opt/anytraverse
config=$destination/etc/anytraverse
units=$destination/etc/systemd/system

fail() {
    printf 'install: %s\n' "$*" >&2
    exit 1
}

if [ -f "$here/../pyproject.toml" ]; then
    source=${1:-$(dirname -- "$here")}
else
    source=${1:-}
    [ -n "$source" ] || fail "say what to install: sh $0 anytraverse_companion-0.1.0-py3-none-any.whl"
fi
if [ -e "$source" ]; then
    source="${source}[rover]"
else
    case $source in
    *://*) ;;
    /* | ./* | ../* | *.whl) fail "there is no $source: name a checkout or a wheel" ;;
    esac
fi

[ -n "$destination" ] || [ "$(id -u)" -eq 0 ] || fail "this needs root: type: sudo sh $0 $*"
"$python" -c 'import ensurepip, struct, sys, venv
sys.exit(sys.version_info < (3, 10) or struct.calcsize("P") != 8)' 2>/dev/null ||
    fail "$python is no 64-bit Python 3.10 or newer with venv: sudo apt install python3-venv, or PYTHON=/path/to/python3"

mkdir -p "$venv" "$config" "$units"
# The environment is made anew only if its pip does not run: a failed download leaves the old program there.
"$venv/bin/python" -m pip --version >/dev/null 2>&1 || "$python" -m venv --clear "$venv"
echo "install: $source into $venv"
"$venv/bin/python" -m pip install --quiet --disable-pip-version-check --upgrade "$source" ||
    fail "pip could not install $source: check the network and type it again"

(cd -- "$here/../config" && find . -type f ! -name '.*') | while IFS= read -r file; do
    [ -e "$config/$file" ] || {
        mkdir -p "$(dirname -- "$config/$file")"
        cp -- "$here/../config/$file" "$config/$file"
    }
done
cp -- "$here/companion.service" "$units/companion.service"

[ -z "$destination" ] || exit 0

for group in video dialout; do
    getent group "$group" >/dev/null || groupadd --system "$group"
done
id anytraverse >/dev/null 2>&1 ||
    useradd --system --user-group --home-dir /var/lib/anytraverse --shell /usr/sbin/nologin anytraverse
usermod --append --groups video,dialout anytraverse # cameras and serial ports
[ ! -d /run/systemd/system ] || systemctl daemon-reload # absent while an SD card image is built
echo "install: done. Edit /etc/anytraverse/companion.toml, then type: sudo systemctl enable companion && sudo systemctl restart companion"
