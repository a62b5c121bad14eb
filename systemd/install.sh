#!/bin/sh
# Installs the companion as a service of this rover: sudo sh systemd/install.sh [SOURCE]
#
# SOURCE is what pip installs: a checkout (default: the one this file is in), a wheel or a requirement.
# Run it again to update: program, unit and device rules are replaced; /etc/anytraverse and /var/lib/anytraverse are not.
# --uninstall removes the service; --uninstall --purge removes settings, memory and user, too.
# --configure makes the user and reloads systemd and udev, for packages. DESTDIR=folder is for packagers: the files go
# there, no user is created and systemctl is not called.
set -eu
umask 022

here=$(cd -- "$(dirname -- "$0")" && pwd -P)
destination=${DESTDIR:-}
python=${PYTHON:-/usr/bin/python3}
opt=$destination/opt
config=$destination/etc/anytraverse
state=/var/lib/anytraverse
units=$destination/etc/systemd/system
rules=$destination/etc/udev/rules.d
local=$destination/usr/local
programs="companion anytraverse anytraverse-console anytraverse-operator"
package=/var/lib/dpkg/info/anytraverse-companion.list
unit_files=$(cd -- "$here" && echo *.service *.socket *.path *.slice)
room_needed=700 # MB: the old program stays until the new one is complete

say() {
    printf 'install: %s\n' "$*"
}

fail() {
    say "$*" >&2
    exit 1
}

booted() {
    [ -z "$destination" ] && [ -d /run/systemd/system ] # absent while an SD card image is built
}

reload() {
    booted || return 0
    systemctl daemon-reload
    if [ -S /run/udev/control ]; then # a container has no udev
        udevadm control --reload
        udevadm trigger --subsystem-match=tty --subsystem-match=video4linux --subsystem-match=usb || true
    fi
}

configure() {
    for group in video dialout; do
        getent group "$group" >/dev/null || groupadd --system "$group"
    done
    id anytraverse >/dev/null 2>&1 ||
        useradd --system --user-group --home-dir "$state" --shell /usr/sbin/nologin anytraverse
    usermod --append --groups dialout anytraverse # serial ports
    # Cameras are the vision process's, which has a user of its own, since an earlier release.
    ! id -nG anytraverse | grep -qw video || gpasswd --delete anytraverse video >/dev/null
    for word in $(cat /proc/cmdline 2>/dev/null || true); do
        case $word in
        console=serial* | console=ttyAMA* | console=ttyS* | console=ttyTHS*)
            console=${word#console=}
            say "note: ${console%%,*} is this system's console: an autopilot needs another port, or turn the console off (raspi-config: Interface Options, Serial Port)"
            ;;
        esac
    done
    reload
}

# Makes $1 a link to $2 of the program, unless somebody else's file is there.
link() {
    if [ -e "$1" ] || [ -L "$1" ]; then
        [ "$(readlink "$1")" = "/opt/anytraverse/$2" ] ||
            say "note: $1 is not of this installation, and stays as it is: type /opt/anytraverse/$2"
        return 0
    fi
    mkdir -p "$(dirname -- "$1")"
    ln -s "/opt/anytraverse/$2" "$1"
}

link_all() {
    for program in $programs; do
        link "$local/bin/$program" "bin/$program"
        for file in "man/man1/$program.1" "bash-completion/completions/$program" "zsh/site-functions/_$program"; do
            [ ! -e "$opt/$new/share/$file" ] || link "$local/share/$file" "share/$file"
        done
    done
}

unlink_all() {
    for link in "$local"/bin/* "$local"/share/man/man1/* "$local"/share/bash-completion/completions/* "$local"/share/zsh/site-functions/*; do
        [ ! -L "$link" ] || case $(readlink "$link") in /opt/anytraverse/*) rm -f "$link" ;; esac
    done
}

# Writes manual pages and completion of bash and zsh. What it needs for that is removed again.
write_pages() {
    "$opt/$new/bin/python" -m pip install --quiet --disable-pip-version-check --target "$opt/$new/pages" argparse-manpage shtab &&
        PYTHONPATH=$opt/$new/pages "$opt/$new/bin/python" "$here/shell_files.py" "$opt/$new/share" ||
        say "note: there are no manual pages and no completion: the lines above say why"
    rm -rf "${opt:?}/$new/pages"
}

# Removes what the program never imports: all MAVLink dialects but two, and numpy's tests.
slim() {
    for site in "$opt/$new"/lib/python3*/site-packages; do
        [ -d "$site" ] || continue
        find "$site/pymavlink/dialects" -type f ! -name '__init__.*' ! -path '*/v20/*common.*' ! -path '*/v20/*development.*' -delete
        find "$site/numpy" -type d -name tests -prune -exec rm -rf {} +
    done
}

uninstall() {
    [ ! -e "$package" ] || fail "a Debian package installed it: type: sudo apt remove anytraverse-companion"
    ! booted || systemctl disable --now companion 2>/dev/null || true
    for file in $unit_files; do
        rm -f "$units/$file" "$units/$file.d/10-hardening.conf"
        rmdir "$units/$file.d" 2>/dev/null || true # your own drop-ins stay
    done
    rm -f "$rules/70-anytraverse.rules"
    rm -rf /run/systemd/system.control/companion-camera.slice.d
    unlink_all
    rm -rf "$opt/anytraverse" "$opt/anytraverse-a" "$opt/anytraverse-b"
    reload
    if [ "$1" != --purge ]; then
        say "removed. Your settings in $config and what it was taught in $state are kept"
        say "to remove them, too, type: sudo sh $0 --uninstall --purge"
        return
    fi
    rm -rf "$config" "${state:?}" /var/cache/anytraverse-* /var/cache/private/anytraverse-*
    ! id anytraverse >/dev/null 2>&1 || userdel anytraverse
    say "removed, with settings, memory and user"
}

check_computer() {
    "$python" -c 'import ensurepip, struct, sys, venv
sys.exit(sys.version_info < (3, 10) or struct.calcsize("P") != 8)' 2>/dev/null ||
        fail "$python is no 64-bit Python 3.10 or newer with venv: sudo apt install python3-venv, or PYTHON=/path/to/python3"
    place=$opt
    while [ ! -d "$place" ]; do place=$(dirname -- "$place"); done
    # shellcheck disable=SC2046 # the words of df's last line: device, blocks, used, available
    set -- $(df -Pk -- "$place" | tail -n 1)
    free=$(($4 / 1024))
    [ "$free" -ge "$room_needed" ] || fail "$place has $free MB free, and $room_needed MB are needed: make room"
}

case ${1:-} in
--uninstall | --configure)
    [ -z "$destination" ] || fail "$1 works on this computer only: leave DESTDIR out"
    [ "$(id -u)" -eq 0 ] || fail "this needs root: type: sudo sh $0 $*"
    if [ "$1" = --configure ]; then configure; else uninstall "${2:-}"; fi
    exit 0
    ;;
-*) fail "what is $1? Type: sudo sh $0 [SOURCE], or --uninstall, or --uninstall --purge" ;;
esac

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
[ -n "$destination" ] || [ ! -e "$package" ] || fail "a Debian package installed it: type: sudo apt remove anytraverse-companion"

say "1/4 check this computer"
check_computer

# The new program is made beside the old one, which runs on meanwhile and stays if anything fails.
new=anytraverse
if [ -z "$destination" ]; then
    new=anytraverse-a
    [ "$(readlink "$opt/anytraverse" || true)" != "$new" ] || new=anytraverse-b
fi
say "2/4 install $source into $opt/$new: this takes a minute or more"
mkdir -p "$opt" "$config" "$units" "$rules"
rm -rf "${opt:?}/$new"
"$python" -m venv "$opt/$new"
"$opt/$new/bin/python" -m pip install --quiet --disable-pip-version-check "$source" || {
    rm -rf "${opt:?}/$new"
    fail "pip could not install $source: check the network and type it again"
}
write_pages
slim

say "3/4 write settings, unit and device rules; what is in $config stays as it is"
(cd -- "$here/../config" && find . -type f ! -name '.*') | while IFS= read -r file; do
    [ -e "$config/$file" ] || {
        mkdir -p "$(dirname -- "$config/$file")"
        cp -- "$here/../config/$file" "$config/$file"
    }
done
for file in $unit_files; do
    cp -- "$here/$file" "$units/$file"
    case $file in
    companion*.service)
        mkdir -p "$units/$file.d"
        cp -- "$here/hardening.conf" "$units/$file.d/10-hardening.conf"
        ;;
    esac
done
cp -- "$here/70-anytraverse.rules" "$rules/70-anytraverse.rules"
link_all
if [ -n "$destination" ]; then
    # Programs and byte code name the folder they will be in.
    for program in "$opt/$new"/bin/*; do
        [ ! -f "$program" ] || [ -L "$program" ] || sed -i "s|$destination/opt|/opt|g" "$program"
    done
    [ ! -f "$opt/$new/pyvenv.cfg" ] || sed -i "s|$destination/opt|/opt|g" "$opt/$new/pyvenv.cfg"
    exit 0
fi

say "4/4 make user, groups and devices known"
configure
old=$(readlink "$opt/anytraverse" || true)
[ -n "$old" ] || rm -rf "$opt/anytraverse" # earlier releases made a folder
ln -sfn "$new" "$opt/anytraverse.new"
mv -T "$opt/anytraverse.new" "$opt/anytraverse"
! booted || systemctl try-restart companion || say "it does not start: see journalctl -u companion"
[ -z "$old" ] || rm -rf "${opt:?}/$old"

release=$("$opt/anytraverse/bin/companion" --version)
if booted && systemctl --quiet is-active companion; then
    say "done: $release runs, with your settings of before. To see what it does, type:"
    say "  sudo companion status"
else
    say "done: $release is installed and does not run yet. Name your camera and your autopilot, then start it. Type:"
    say "  sudo companion setup    (or: sudoedit $config/companion.toml)"
    say "  sudo systemctl enable --now companion"
    say "  sudo companion status"
fi
