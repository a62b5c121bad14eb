"""Boots the installed service in a virtual machine, for what a container has not: devices, and no clock."""

from __future__ import annotations

import json
import shutil
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

from bench.service.container import ROOT, ContainerError, base, run

PACKAGES = "linux-image-amd64 initramfs-tools zstd busybox-static"
_MACHINE = """qemu-system-x86_64 -accel tcg,thread=multi -cpu max -m 2048 -smp 2 -display none -no-reboot
-net none -rtc base=1970-01-01T00:00:00"""
_BOOTS_WITHIN = 300.0
_CONFIG = """
[camera]
source = "http://127.0.0.2:8080/video"
[web]
listen = ""
[vehicle]
file = ""
[link]
url = "serial:/dev/anytraverse-autopilot:115200"
budget = 300.0
"""
_TEST = """[Unit]
After=multi-user.target
[Service]
Type=oneshot
ExecStart=-/usr/bin/python3 -u /root/in_vm.py
ExecStopPost=/usr/bin/systemctl --no-block poweroff
StandardOutput=file:/dev/ttyS1
StandardError=inherit
[Install]
WantedBy=graphical.target
"""
_PROBE = """
import json, os, socket, time
def tried(path, mode):
    until = time.monotonic() + 30
    while not os.path.exists(path) and time.monotonic() < until:
        time.sleep(0.1)
    try:
        os.close(os.open(path, mode))
        return "opened"
    except OSError as error:
        return error.strerror
import cv2
said = {"video": tried("/dev/video0", os.O_RDWR)}
camera = cv2.VideoCapture("/dev/video0", cv2.CAP_V4L2)
said["frame"] = camera.read()[0]
said["autopilot"] = tried("/dev/anytraverse-autopilot", os.O_RDWR | os.O_NONBLOCK)
def sent(host):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        try:
            return "sent" if out.sendto(b"probe", (host, 9)) else "nothing"
        except OSError as error:
            return error.strerror
said["camera_address"], said["other_address"] = sent("127.0.0.2"), sent("127.0.0.1")
nodes = [os.path.join(at, name) for at, _, names in os.walk("/dev/bus/usb") for name in names]
oaks = [node for node in nodes if os.stat(node).st_mode & 0o777 == 0o660]
said["oak"] = [tried(node, os.O_RDWR) for node in oaks]
said["disk"] = tried("/dev/vda", os.O_RDONLY)
said["fuse"] = tried("/dev/fuse", os.O_RDWR)
open("/run/anytraverse-probe/probe", "w").write(json.dumps(said))
"""


def devices(cache: Path, wheels: Path, checkout: Path) -> dict[str, Any]:
    """Install into a virtual machine, boot it without a clock, and plug devices in. Returns its figures."""
    for tool in ("qemu-system-x86_64", "mkfs.ext4"):
        if shutil.which(tool) is None:
            raise ContainerError(f"{tool} is missing: type: sudo apt install qemu-system-x86 e2fsprogs")
    with tempfile.TemporaryDirectory(prefix="anytraverse-service-") as folder:
        root, image = Path(folder, "root"), Path(folder, "disk")
        run(["cp", "-a", "--reflink=auto", str(_base_with_kernel(cache)), str(root)], "cp")
        _install(root, wheels, checkout)
        run(["truncate", "-s", "3G", str(image)], "truncate")
        run(["mkfs.ext4", "-q", "-d", str(root), str(image)], "mkfs.ext4")
        kernel, ramdisk = (
            next((root / "boot").glob(f"{name}-*-amd64")) for name in ("vmlinuz", "initrd.img")
        )
        return _boot(Path(folder), kernel, ramdisk, image)


def _base_with_kernel(cache: Path) -> Path:
    root = cache / "vm"
    if not root.exists():
        unfinished = cache / "vm.part"
        shutil.rmtree(unfinished, ignore_errors=True)
        run(["cp", "-a", "--reflink=auto", str(base(cache)), str(unfinished)], "cp")
        get = (
            f"apt-get update -q && apt-get install -q -y --no-install-recommends {PACKAGES} && apt-get clean"
        )
        run(["chroot", str(unfinished), "env", "DEBIAN_FRONTEND=noninteractive", "sh", "-c", get], "apt-get")
        unfinished.rename(root)
    return root


def _install(root: Path, wheels: Path, checkout: Path) -> None:
    inside = ["systemd-nspawn", "--quiet", f"--directory={root}", "--register=no", "--keep-unit", "--pipe"]
    inside += [f"--bind-ro={wheels}:/wheels", f"--bind-ro={checkout}:/checkout"]
    install = "PIP_NO_INDEX=1 PIP_FIND_LINKS=/wheels sh /checkout/systemd/install.sh"
    run([*inside, "sh", "-c", install], "install.sh")
    (root / "etc/anytraverse/companion.toml").write_text(_CONFIG)
    shutil.copy(ROOT / "bench/service/in_vm.py", root / "root/in_vm.py")
    units = root / "etc/systemd/system"
    (units / "in-vm.service").write_text(_TEST)
    (root / "opt/probe.py").write_text(_PROBE)
    vision, hardening = units / "companion-network-vision@.service", ROOT / "systemd/hardening.conf"
    (units / "probe.service").write_text(_probe(vision.read_text() + hardening.read_text()))
    run(["chroot", str(root), "systemctl", "enable", "companion", "in-vm"], "systemctl enable")


def _probe(unit: str) -> str:
    """Return the vision process's unit with another program: the same user, devices and system calls."""
    lines = unit.splitlines()
    here = lines.index("[Service]") + 1
    lines[here:here] = ["Type=exec", "RuntimeDirectory=anytraverse-probe", "RuntimeDirectoryPreserve=yes"]
    program = "ExecStart=/opt/anytraverse/bin/python /opt/probe.py"
    return "\n".join(program if line.startswith("ExecStart=") else line for line in lines)


def _boot(folder: Path, kernel: Path, ramdisk: Path, image: Path) -> dict[str, Any]:
    result, console = folder / "result", folder / "console"
    asked = [*_MACHINE.split(), "-kernel", str(kernel), "-initrd", str(ramdisk)]
    asked += ["-append", "root=/dev/vda rw console=ttyS0 quiet"]
    asked += ["-drive", f"file={image},format=raw,if=virtio"]
    asked += ["-serial", f"file:{console}", "-serial", f"file:{result}"]
    begun = time.monotonic()
    try:
        subprocess.run(
            asked, check=False, stdin=subprocess.DEVNULL, timeout=_BOOTS_WITHIN, capture_output=True
        )
    except subprocess.TimeoutExpired as error:
        raise ContainerError(
            f"the machine did not end: {console.read_text(errors='replace')[-2000:]}"
        ) from error
    said = result.read_text(errors="replace") if result.exists() else ""
    lines = [line for line in said.splitlines() if line.startswith("{")]
    if not lines:
        raise ContainerError(f"no result\n{said[-3000:]}\n{console.read_text(errors='replace')[-2000:]}")
    found: dict[str, Any] = json.loads(lines[-1])
    probe = found["probe"]
    wanted = {"video": "opened", "frame": True, "oak": ["opened"], "camera_address": "sent"}
    wrong = {name: probe.get(name) for name, value in wanted.items() if probe.get(name) != value}
    # Everybody may write to /dev/fuse: only the unit forbids it. The autopilot's port is the supervisor's.
    forbidden = probe["fuse"], probe["disk"], probe["autopilot"], probe["other_address"]
    if wrong or {"opened", "sent"} & {*forbidden} or not found["same_process"]:
        raise ContainerError(f"devices: {found}")
    return {**found, "machine_s": round(time.monotonic() - begun, 1)}
