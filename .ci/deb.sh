#!/bin/sh
# Builds dist/anytraverse-companion_VERSION_ARCHITECTURE.deb for this system's Python: sh .ci/deb.sh
# The package holds the program with all that it needs, and downloads nothing when it is installed.
set -eu
umask 022
cd -- "$(dirname -- "$0")/.."

fail() {
    printf 'deb: %s\n' "$*" >&2
    exit 1
}

python=/usr/bin/python3
command -v dpkg-deb >/dev/null || fail "dpkg-deb is missing: this needs Debian, Ubuntu or Raspberry Pi OS"
version=$(sed -n 's/^version = "\(.*\)"$/\1/p' pyproject.toml)
architecture=$(dpkg --print-architecture)
mkdir -p dist
stage=$(mktemp -d "$(pwd -P)/dist/deb.XXXXXX")
trap 'rm -rf "$stage"' EXIT
chmod 755 "$stage"

DESTDIR=$stage PYTHON=$python sh systemd/install.sh "anytraverse-companion[words] @ file://$PWD"
echo "deb: pack it"
"$stage/opt/anytraverse/bin/python" -m compileall -q -f -s "$stage" "$stage/opt/anytraverse/lib"
mkdir -p "$stage/usr/lib/systemd/system" "$stage/usr/lib/udev/rules.d" "$stage/DEBIAN"
[ -d "$stage/usr/local/share/man" ] || fail "the manual pages are missing: the lines above say why"
mv "$stage"/usr/local/share "$stage"/usr/local/bin "$stage/usr"
rmdir "$stage/usr/local"
mv "$stage/usr/share/zsh/site-functions" "$stage/usr/share/zsh/vendor-completions"
links=$(cd "$stage" && find usr/bin usr/share -type l | sort | tr '\n' ' ')
mv "$stage"/etc/systemd/system/* "$stage/usr/lib/systemd/system"
mv "$stage/etc/udev/rules.d/70-anytraverse.rules" "$stage/usr/lib/udev/rules.d"
rm -r "$stage/etc/systemd" "$stage/etc/udev"
(cd "$stage" && find etc -type f | sed 's|^|/|') >"$stage/DEBIAN/conffiles"
script=$(cd "$stage" && echo opt/anytraverse/lib/python3*/site-packages/companion/data/systemd/install.sh)
[ -f "$stage/$script" ] || fail "the program brings no install.sh"

pythons=$("$python" -c 'import sys
major, minor = sys.version_info[:2]
print(f"python3 (>= {major}.{minor}), python3 (<< {major}.{minor + 1}~)")')
cat >"$stage/DEBIAN/control" <<X
Package: anytraverse-companion
Version: $version
Architecture: $architecture
Maintainer: The AnyTraverse companion developers
Installed-Size: $(du -sk "$stage" | cut -f1)
Depends: $pythons, libstdc++6, passwd, systemd, udev
Recommends: openssh-client
Section: misc
Priority: optional
Description: companion of an off-road rover: which ground is drivable, and who to ask
 The daemon looks at the trail through a camera and decides, by words that the
 operator chose, which ground is drivable. Where no word describes it, it stops
 the rover and asks the operator over MAVLink.
X
cat >"$stage/DEBIAN/preinst" <<X
#!/bin/sh
set -e
if [ -L /opt/anytraverse ]; then
    echo "anytraverse-companion: install.sh installed it before: type: sudo sh systemd/install.sh --uninstall" >&2
    exit 1
fi
# dpkg would overwrite what is there and of no package.
for link in $links; do
    if [ -e "/\$link" ] || [ -L "/\$link" ]; then
        case \$(readlink "/\$link") in
        /opt/anytraverse/*) ;;
        *)
            echo "anytraverse-companion: /\$link is not of this package: move it away, then install again" >&2
            exit 1
            ;;
        esac
    fi
done
X
cat >"$stage/DEBIAN/postinst" <<X
#!/bin/sh
set -e
[ "\$1" = configure ] || exit 0
sh /$script --configure
[ ! -d /run/systemd/system ] || systemctl try-restart companion || true
[ -n "\$2" ] || echo "anytraverse-companion: type: sudo companion setup (or: sudoedit /etc/anytraverse/companion.toml), then: sudo systemctl enable --now companion"
X
cat >"$stage/DEBIAN/prerm" <<'X'
#!/bin/sh
set -e
[ "$1" = upgrade ] || [ ! -d /run/systemd/system ] || systemctl disable --now companion 2>/dev/null || true
X
cat >"$stage/DEBIAN/postrm" <<'X'
#!/bin/sh
set -e
if [ "$1" = remove ] || [ "$1" = purge ]; then
    [ ! -d /run/systemd/system ] || systemctl daemon-reload
fi
if [ "$1" = purge ]; then
    rm -rf /etc/anytraverse /var/lib/anytraverse /var/cache/anytraverse-* /var/cache/private/anytraverse-*
    ! id anytraverse >/dev/null 2>&1 || userdel anytraverse
fi
X
chmod 755 "$stage/DEBIAN/preinst" "$stage/DEBIAN/postinst" "$stage/DEBIAN/prerm" "$stage/DEBIAN/postrm"
package=dist/anytraverse-companion_${version}_$architecture.deb
dpkg-deb --root-owner-group -Zzstd -z6 --build "$stage" "$package" >/dev/null
echo "deb: $package, $(($(du -k "$package" | cut -f1) / 1024)) MB. To install it, type: sudo apt install ./$package"
