#!/bin/sh
# Builds dist/anytraverse-companion_VERSION_ARCHITECTURE.oci.tar, an image for podman: sudo sh .ci/image.sh
# It is a small Debian of this system's release with the package of .ci/deb.sh, which says what is installed.
# ARCH=arm64 takes the package that `make deb` made on such a computer from dist/ (untried).
set -eu
umask 022
cd -- "$(dirname -- "$0")/.."

fail() {
    printf 'image: %s\n' "$*" >&2
    exit 1
}

here=$(dpkg --print-architecture 2>/dev/null) || fail "dpkg is missing: this needs Debian, Ubuntu or Raspberry Pi OS"
architecture=${ARCH:-$here}
version=$(sed -n 's/^version = "\(.*\)"$/\1/p' pyproject.toml)
name=anytraverse-companion_${version}_$architecture
package=$PWD/dist/$name.deb
[ "$(id -u)" -eq 0 ] || fail "this needs root: type: sudo make image"
missing=
for tool in mmdebstrap buildah; do
    command -v "$tool" >/dev/null || missing="$missing $tool"
done
[ -z "$missing" ] || fail "type: sudo apt install --no-install-recommends$missing"
if [ "$architecture" = "$here" ]; then
    sh .ci/deb.sh
elif [ ! -f "$package" ]; then
    fail "there is no dist/$name.deb: type make deb on a computer of that kind, and copy it here"
fi

work=$(mktemp -d "$PWD/dist/image.XXXXXX")
container=
trap '[ -z "$container" ] || buildah rm "$container" >/dev/null; rm -rf "$work"' EXIT
release=$(. /etc/os-release && echo "$VERSION_CODENAME")
echo "image: a Debian root of $release for $architecture"
# There is no systemd in it: what would be for that, and for udev, is left out. catatonit is process 1, and reaps.
mmdebstrap --quiet --variant=essential --architectures="$architecture" --include=ca-certificates,catatonit,libstdc++6,openssh-client,passwd,python3 \
    --dpkgopt="path-exclude=/usr/lib/systemd/*" --dpkgopt="path-exclude=/usr/lib/udev/*" \
    --dpkgopt="path-exclude=/usr/share/man/*" --dpkgopt="path-exclude=/usr/share/locale/*" \
    --dpkgopt="path-exclude=/usr/share/doc/*" --dpkgopt="path-include=/usr/share/doc/*/copyright" \
    --customize-hook="upload '$package' /package.deb" \
    --customize-hook='chroot "$1" dpkg --ignore-depends=systemd,udev --install /package.deb >/dev/null' \
    --customize-hook='chroot "$1" usermod --append --groups video anytraverse' \
    --customize-hook='chroot "$1" install -d -o anytraverse -g anytraverse -m 751 /var/lib/anytraverse' \
    --customize-hook='rm "$1/package.deb"' "$release" "$work/root.tar"

echo "image: pack it"
container=$(buildah from --arch "$architecture" scratch)
buildah add --quiet "$container" "$work/root.tar" / >/dev/null
# $WATCHDOG_USEC: a companion that hangs ends itself. $RUNTIME_DIRECTORY: there it counts failures, and waits longer.
buildah config --arch "$architecture" --os linux --user anytraverse --workingdir /var/lib/anytraverse \
    --entrypoint '["catatonit", "--", "companion"]' --cmd "run --config /etc/anytraverse/companion.toml" \
    --stop-signal SIGTERM --volume /var/lib/anytraverse \
    --env PYTHONUNBUFFERED=1 --env container=oci --env WATCHDOG_USEC=5000000 \
    --env STATE_DIRECTORY=/var/lib/anytraverse --env RUNTIME_DIRECTORY=/var/lib/anytraverse \
    --label org.opencontainers.image.title=anytraverse-companion \
    --label "org.opencontainers.image.version=$version" --label org.opencontainers.image.licenses=Apache-2.0 "$container"
rm -f "dist/$name.oci.tar"
buildah commit --quiet --disable-compression=false --format oci "$container" "oci-archive:dist/$name.oci.tar:localhost/anytraverse-companion:$version" >/dev/null
echo "image: dist/$name.oci.tar, $(($(du -k "dist/$name.oci.tar" | cut -f1) / 1024)) MB. To load it, type: sudo podman load -i dist/$name.oci.tar"
