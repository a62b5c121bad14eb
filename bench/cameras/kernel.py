"""Tries V4L2 in a real kernel without a camera: Debian's, with its virtual camera vivid, in an emulator.

`sudo make vm` runs it with the system that `bench.service` makes: `python -m bench.cameras.kernel FOLDER`,
with a folder that has boot/vmlinuz-*, lib/modules and a static bin/busybox. It needs qemu-system-x86. The
guest sees the files of this computer, read-only, and runs this module.
The last line is JSON: what each way to open the camera gave; and of losses, in which the camera is unbound
from its driver and bound again, the longest times in s until they were noticed and until pictures were back.
"""

from __future__ import annotations

import ctypes
import json
import os
import re
import shlex
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from companion.cameras import CameraError, CameraOptions, open_camera
from companion.cameras.newest import CameraState, CameraThread, Patience
from companion.cameras.v4l2 import Device, devices

ROOT = Path(__file__).parents[2]
LASTS = 600.0
LOSSES = 10
_NEEDED = ("virtio_pci", "9pnet_virtio", "9p", "vivid")
_DRIVER = Path("/sys/bus/platform/drivers/vivid")
_FINIT_MODULE = 313
_T = 2.0
_SOON = 60.0
_NOBODY = 65534
_INIT = """#!/bin/busybox sh
bb=/bin/busybox
$bb mkdir -p /proc /sys /dev /host
$bb mount -t proc proc /proc; $bb mount -t sysfs sys /sys; $bb mount -t devtmpfs dev /dev
for module in {early}; do $bb insmod /m/$module.ko; done
$bb mount -t 9p -o trans=virtio,version=9p2000.L,ro,cache=loose,msize=262144 host /host
for name in proc sys dev; do $bb mount -o bind /$name /host/$name; done
$bb mount -t tmpfs tmp /host/run; $bb cp -r /m /host/run/m
export PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/run TMPDIR=/run PYTHONDONTWRITEBYTECODE=1 PYTHONPATH={root}
$bb chroot /host {python} -m bench.cameras.kernel --inside
$bb poweroff -f
"""
_OPTIONS: Mapping[str, Mapping[str, Any]] = {
    "as it is": {},
    "640 x 360": {"width": 640, "height": 360},
    "a size that it has not": {"width": 641, "height": 361},
    "yuyv422": {"pixel_format": "yuyv422"},
    "nv12": {"pixel_format": "nv12"},
    "rgb24": {"pixel_format": "rgb24"},
    "gray": {"pixel_format": "gray"},
    "a format that it has not": {"pixel_format": "mjpeg"},
    "an exposure that it has not": {"exposure": 0.01},
    "10 frames/s": {"fps": 10.0},
}


def main() -> int:
    """Run the emulator, or within it the checks."""
    if sys.argv[1:] == ["--inside"]:
        print("\n" + json.dumps(_inside()), flush=True)
        return 0
    folder = Path(sys.argv[1])
    (image,) = (folder / "boot").glob("vmlinuz-*")
    with tempfile.NamedTemporaryFile() as packed:
        packed.write(_ram_disk(folder))
        packed.flush()
        ran = subprocess.run(
            [
                *(
                    "qemu-system-x86_64",
                    "-accel",
                    "tcg",
                    "-cpu",
                    "max",
                    "-m",
                    "1600",
                    "-nographic",
                    "-no-reboot",
                ),
                *("-kernel", str(image), "-initrd", packed.name, "-append", "console=ttyS0 quiet panic=-1"),
                *("-virtfs", "local,path=/,mount_tag=host,security_model=none,readonly=on,multidevs=remap"),
            ],
            capture_output=True,
            text=True,
            errors="replace",
            timeout=LASTS,
            check=True,
        )
    found = [line for line in ran.stdout.splitlines() if line.startswith('{"kernel"')]
    print(found[-1] if found else ran.stdout)
    return 0 if found else 1


def _ram_disk(folder: Path) -> bytes:
    """Pack busybox, the modules and the first program as a cpio archive."""
    files = {path.stem.replace("-", "_"): path for path in folder.glob("lib/modules/*/kernel/**/*.ko")}
    modules = list(dict.fromkeys(name for last in _NEEDED for name in _with_needed(last, files)))
    early = " ".join(name for name in modules if name != "vivid")
    init = _INIT.format(early=early, root=shlex.quote(str(ROOT)), python=shlex.quote(sys.executable))
    packed = bytearray()
    for name in ("bin", "dev", "m"):
        _pack(packed, name, b"", 0o40755)
    _pack(packed, "dev/console", b"", 0o20600, (5, 1))
    _pack(packed, "bin/busybox", (folder / "bin/busybox").read_bytes(), 0o100755)
    _pack(packed, "init", init.encode(), 0o100755)
    for name in modules:
        _pack(packed, f"m/{name}.ko", files[name].read_bytes(), 0o100644)
    _pack(packed, "TRAILER!!!", b"", 0)
    return bytes(packed)


def _with_needed(name: str, files: Mapping[str, Path]) -> Iterator[str]:
    """Yield the modules that a module needs, then itself. What is no module is built into the kernel."""
    if name not in files:
        return
    listed = re.search(rb"\0depends=([^\0]*)\0", files[name].read_bytes())
    for needed in listed[1].decode().split(",") if listed else ():
        yield from _with_needed(needed.replace("-", "_"), files)
    yield name


def _pack(packed: bytearray, name: str, data: bytes, mode: int, device: tuple[int, int] = (0, 0)) -> None:
    path = name.encode() + b"\0"
    fields = (len(packed) + 1, mode, 0, 0, 1, 0, len(data), 0, 0, *device, len(path), 0)
    packed += b"070701" + b"".join(b"%08x" % field for field in fields) + path
    packed += bytes(-len(packed) % 4) + data
    packed += bytes(-len(packed) % 4)


def _inside() -> dict[str, Any]:
    """Try everything with the one camera of this kernel."""
    with open("/run/m/vivid.ko", "rb") as module:
        loaded = ctypes.CDLL(None).syscall(_FINIT_MODULE, module.fileno(), b"n_devs=1 node_types=0x1", 0)
    (found,) = devices()
    assert isinstance(found, Device), found
    source = f"v4l2:{found.path}"
    opened = {name: _try(source, CameraOptions(freshness=_T, **given)) for name, given in _OPTIONS.items()}
    first = open_camera(source, CameraOptions(freshness=_T))
    first.read(_T)
    opened["while another reads it"] = _try(source, CameraOptions(freshness=_T))
    first.close()
    os.chmod(found.path, 0o600)
    os.seteuid(_NOBODY)
    opened["without the right to"] = _try(source, CameraOptions(freshness=_T))
    os.seteuid(0)
    return {"kernel": os.uname().release, "loaded": loaded == 0, "opened": opened, **_losses(source)}


def _try(source: str, options: CameraOptions) -> str:
    """Open the camera and say what its third picture is, or why there is none."""
    try:
        camera = open_camera(source, options)
    except CameraError as error:
        return str(error)
    try:
        capture = [camera.read(_T) for _ in range(3)][-1]
    except CameraError as error:
        return str(error)
    finally:
        camera.close()
    height, width, _ = capture.image.shape
    return f"{width} x {height}, time from {capture.timed_by}"


def _losses(source: str) -> dict[str, Any]:
    thread = CameraThread(
        partial(open_camera, source, CameraOptions(freshness=_T)), patience=Patience(late=_T)
    )
    assert thread.take(_SOON) is not None
    (device,) = [path.name for path in _DRIVER.iterdir() if path.name.startswith("vivid.")]
    noticed, back = list[float](), list[float]()
    for _ in range(LOSSES):
        (_DRIVER / "unbind").write_text(device)
        lost_at = time.monotonic()
        while thread.state is not CameraState.FAILED and time.monotonic() - lost_at < _SOON:
            time.sleep(0.01)
        noticed.append(round(time.monotonic() - lost_at, 2))
        time.sleep(2.0)
        while thread.take(0.0) is not None:
            pass
        (_DRIVER / "bind").write_text(device)
        returned_at = time.monotonic()
        assert thread.take(_SOON) is not None
        back.append(round(time.monotonic() - returned_at, 2))
    thread.close()
    return {"losses": LOSSES, "noticed_max_s": max(noticed), "back_max_s": max(back)}


if __name__ == "__main__":
    sys.exit(main())
