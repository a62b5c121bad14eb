"""Runs as root inside the virtual machine, started by a unit: plugs devices in, prints one JSON object.

Nothing of the checkout is imported here. The kernel plays the devices: vivid a camera, dummy_hcd with USB
gadgets an autopilot and an OAK camera. They are plugged in after the service has started.
"""

from __future__ import annotations

import json
import os
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

STATUS = Path("/var/lib/anytraverse/status.json")
GADGETS = Path("/sys/kernel/config/usb_gadget")
PROBE = Path("/run/anytraverse-probe/probe")
AUTOPILOT = Path("/dev/anytraverse-autopilot")
WITHIN = 60.0
LOSSES = 10
PLAY = """
import os, sys, time, tty
from pymavlink.dialects.v20 import common as m
fd = os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
tty.setraw(fd)
rover, ear, until = m.MAVLink(None, 1, 1), m.MAVLink(None), time.monotonic() + 60
ear.robust_parsing = True
while time.monotonic() < until:
    time.sleep(0.5)
    try:
        os.write(fd, m.MAVLink_heartbeat_message(10, 3, 81, 0, 3, 3).pack(rover))
        heard = ear.parse_buffer(os.read(fd, 4096)) or []
    except BlockingIOError:
        continue
    if any(one.get_type() == "HEARTBEAT" and one.get_srcComponent() == 191 for one in heard):
        sys.exit(0)
sys.exit("the companion was not heard")
"""


def main() -> None:
    """Plug, look, pull, plug again."""
    found: dict[str, Any] = {"clock_at_start": time.strftime("%Y-%m-%d", time.gmtime())}
    sh("modprobe -a libcomposite usb_f_acm fuse && modprobe dummy_hcd num=2")
    sh("mountpoint -q /sys/kernel/config || mount -t configfs none /sys/kernel/config")
    until("the service is active", lambda: sh("systemctl is-active companion || true") == "active")
    pid = sh("systemctl show --property=MainPID --value companion")
    until("it reports a fault", lambda: status().get("state") == "fault")
    found["fault_without_devices"] = True
    sh("systemctl start --no-block probe")
    until("the probe runs", lambda: sh("systemctl is-active probe || true") in ("active", "activating"))
    udcs = sorted(os.listdir("/sys/class/udc"))
    sh("modprobe vivid n_devs=1")
    found["fuse_mode"] = oct(os.stat("/dev/fuse").st_mode & 0o777)
    plug("oak", "0x03e7", "0x2485", "Luxonis", udcs[1])
    plug("autopilot", "0x1209", "0x5741", "ArduPilot", udcs[0])
    found["autopilot_name_s"] = until("its stable name", AUTOPILOT.exists)
    found["autopilot_group"] = AUTOPILOT.group()
    found["hears_companion_s"] = exchange()
    found["losses"] = LOSSES
    lost, back = zip(*(lose_autopilot(udcs[0]) for _ in range(LOSSES)), strict=True)
    found["loss_reported_s"], found["hears_it_again_s"] = max(lost), max(back)
    until("the probe", PROBE.exists)
    found["probe"] = json.loads(PROBE.read_text())
    found["same_process"] = pid == sh("systemctl show --property=MainPID --value companion")
    print(json.dumps(found))


def plug(name: str, vendor: str, product: str, maker: str, udc: str) -> None:
    """Plug a USB device with one serial port in."""
    gadget = GADGETS / name
    strings = gadget / "strings" / "0x409"
    configuration = gadget / "configs" / "c.1"
    for folder in (strings, configuration, gadget / "functions" / "acm.0"):
        folder.mkdir(parents=True)
    (gadget / "idVendor").write_text(vendor)
    (gadget / "idProduct").write_text(product)
    (strings / "manufacturer").write_text(maker)
    (strings / "product").write_text(name)
    (configuration / "acm.0").symlink_to(gadget / "functions" / "acm.0")
    (gadget / "UDC").write_text(udc)


def lose_autopilot(udc: str) -> tuple[float, float]:
    """Pull the autopilot and plug it in again; return the seconds until each was noticed."""
    (GADGETS / "autopilot" / "UDC").write_text("\n")
    lost = until("the loss", lambda: "lost" in trouble())
    (GADGETS / "autopilot" / "UDC").write_text(udc)
    return lost, exchange()


def exchange() -> float:
    """Be the autopilot on the gadget's side; return the seconds until it hears the companion (191)."""
    port = (GADGETS / "autopilot" / "functions" / "acm.0" / "port_num").read_text().strip()
    begun = time.monotonic()
    subprocess.run(["/opt/anytraverse/bin/python", "-c", PLAY, f"/dev/ttyGS{port}"], check=True)
    return round(time.monotonic() - begun, 1)


def status() -> dict[str, Any]:
    """Return the daemon's status file."""
    try:
        read = json.loads(STATUS.read_text())
    except (OSError, ValueError):
        return {}
    return read if isinstance(read, dict) else {}


def trouble() -> str:
    """Return what is wrong with the link."""
    return str(status().get("link", {}).get("trouble") or "")


def until(what: str, fits: Callable[[], bool]) -> float:
    """Wait, and return the seconds that it took."""
    begun = time.monotonic()
    while not fits():
        if time.monotonic() - begun > WITHIN:
            log = sh(
                "systemctl status companion probe --no-pager -n 20; ls -l /dev/tty[AGU]* /dev/video*; true"
            )
            raise SystemExit(f"not within {WITHIN:.0f} s: {what}. {status().get('link')} {log}")
        time.sleep(0.1)
    return round(time.monotonic() - begun, 1)


def sh(command: str) -> str:
    """Run a shell command."""
    return subprocess.check_output(["sh", "-c", command], stderr=subprocess.STDOUT, text=True).strip()


if __name__ == "__main__":
    main()
