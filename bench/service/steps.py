"""What is proven of the installed service, one function a step. Each returns its figures, or raises."""

from __future__ import annotations

import re
import shlex
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

from bench.service.container import ContainerError
from bench.service.rover import FieldProcess, answer
from bench.service.service import CONFIG, STATE, Figures, Service

INSTALL = "PIP_NO_INDEX=1 PIP_FIND_LINKS=/wheels sh /checkout/systemd/install.sh"
BACK_WITHIN = 12.0
ENDS_WITHIN = 2.0
LONGEST_PAUSE = 60.0
KILLS = 3
_NEWER = """dpkg-deb --raw-extract /root/first.deb /root/second
sed -i 's/^Version: .*/&+newer/' /root/second/DEBIAN/control
dpkg-deb -Zzstd -z1 --build /root/second /root/second.deb"""
_INSTALLS_WITHIN = 400.0
_STEADY = 11.0

_LEFT = r"""find / -xdev \( -path /root -o -path /own -o -path /checkout \) -prune \
-o \( -iname '*anytraverse*' -o -lname '/opt/anytraverse/*' \) -print
getent passwd anytraverse"""


def install(service: Service) -> Figures:
    """Install from a checkout, look at what a user sees, and start."""
    begun = time.monotonic()
    said = service.sh(INSTALL, timeout=_INSTALLS_WITHIN)
    seconds = round(time.monotonic() - begun, 1)
    if "systemctl enable --now companion" not in said:
        raise ContainerError(f"it does not say how to start it: {said}")
    service.configure()
    begun = time.monotonic()
    service.sh("systemctl enable --now companion")
    ready = round(time.monotonic() - begun, 2)
    judging = service.until("it judges", service.judges, 20.0)
    page = service.until("its page says that all is well", service.page_is_well, 20.0)
    exposure = service.sh("systemd-analyze security companion --no-pager | tail -n 1")
    found = re.search(r"companion.service: ([0-9.]+)", exposure)
    status = service.sh("companion status").splitlines()
    owner = service.sh("ps -o user= -p $(systemctl show --property=MainPID --value companion)").strip()
    size = int(service.sh("du -sm /opt/anytraverse/").split()[0])
    return {
        "install_s": seconds,
        "ready_s": ready,
        "judging_s": judging,
        "page_well_s": page,
        "exposure": float(found[1]) if found else None,
        "user": owner,
        "status": status[0],
        "size_mb": size,
    }


def sigterm(service: Service) -> Figures:
    """Stop and start it while frames are judged: it ends in order and within 2 s."""
    service.until("it judges", service.judges, 20.0)
    before = service.status().get("words")
    begun = time.monotonic()
    service.stop()
    seconds = round(time.monotonic() - begun, 2)
    result, log = service.show("Result"), service.log(5)
    service.start()
    service.until("it judges again", service.judges, 20.0)
    if result != "success" or "told to stop, and stopped" not in log or seconds > ENDS_WITHIN:
        raise ContainerError(f"stopped with {result} after {seconds} s: {log}")
    if service.status().get("words") != before:
        raise ContainerError(f"words were {before}, and are {service.status().get('words')}")
    return {"stop_s": seconds, "limit_s": ENDS_WITHIN}


def reboot(service: Service) -> Figures:
    """Boot with a camera and an autopilot that are silent; both come later."""
    service.field.pause()
    service.container.power_off()
    booted = round(service.container.boot(), 1)
    active = service.show("ActiveState")
    reports = service.until("it reports a fault", lambda: service.status().get("state") == "fault", 20.0)
    service.sh("sleep 6")  # longer than the watchdog's period
    restarts = int(service.show("NRestarts"))
    service.field.go_on()
    sees = service.until("it sees", service.judges, 30.0)
    if active != "active" or restarts:
        raise ContainerError(f"after the boot it was {active}, and was started again {restarts} times")
    return {"running_s": booted, "fault_reported_s": reports, "restarts": restarts, "sees_after_s": sees}


def kill(service: Service) -> Figures:
    """SIGKILL, some times."""
    times = [_back(service, service.kill) for _ in range(KILLS)]
    return {"kills": KILLS, "back_s": times, "limit_s": BACK_WITHIN}


def hang(service: Service) -> Figures:
    """The supervisor does not turn: the watchdog ends it."""
    seconds = _back(service, service.freeze)
    log = service.log(200)
    if service.watchdog_says not in log:
        raise ContainerError(f"not the watchdog ended it: {log[-3000:]}")
    return {"back_s": seconds, "limit_s": BACK_WITHIN, "traceback": "most recent call first" in log}


def _back(service: Service, harm: Callable[[], None]) -> float:
    service.until("it judges", service.judges, 20.0)
    service.sh(f"sleep {_STEADY}")  # as after a failure that stands alone
    pid = service.pid
    begun = time.monotonic()
    harm()
    service.until("it is back", lambda: service.judges(since=pid), BACK_WITHIN)
    return round(time.monotonic() - begun, 2)


def crash_loop(service: Service) -> Figures:
    """A configuration that cannot be read: it waits longer and longer, up to 60 s, and never gives up."""
    path = service.container.root / CONFIG
    good = path.read_text()
    path.write_text("this is no TOML")
    try:
        begun = float(service.sh("cut -d' ' -f1 /proc/uptime"))
        service.sh("systemctl restart companion", check=False)
        deadline, pauses = time.monotonic() + 400.0, list[float]()
        while [round(pause / 10) for pause in pauses[-2:]] != [6, 6] and time.monotonic() < deadline:
            time.sleep(2.0)
            log = service.sh("journalctl -u companion --no-pager -o short-monotonic")
            ends = [float(at) for at in re.findall(r"\[ *([0-9.]+)\] \S+ systemd.*Main process exited", log)]
            ends = [at for at in ends if at > begun]
            pauses = [round(later - one, 1) for one, later in pairwise(ends)]
        service.until("it waits", service.waits, 10.0)
    finally:
        path.write_text(good)
    begun_at = time.monotonic()
    service.sh("systemctl restart companion")
    service.until("it judges again", service.judges, 20.0)
    if pauses != sorted(pauses) and max(pauses) - min(pauses[-2:]) > 1.0:
        raise ContainerError(f"the pauses do not rise: {pauses}")
    if not LONGEST_PAUSE - 2.0 <= max(pauses) <= LONGEST_PAUSE + 4.0:
        raise ContainerError(f"the longest pause is not {LONGEST_PAUSE:.0f} s: {pauses}")
    return {
        "pauses_s": pauses,
        "mended_back_s": round(time.monotonic() - begun_at, 2),
    }


def _called(status: Figures) -> bool:
    return status.get("state") == "calling" and status.get("held_by") == "companion"


def upgrade(service: Service, wheel: Path) -> Figures:
    """Install a wheel over it while a call is open: call, words and configuration are as before."""
    # In the steps before, the autopilot's script held the rover: a new one drives from the trail's beginning.
    # The companion is stopped meanwhile: a fault's hold would come first.
    service.stop()
    service.field.close()
    service.field = FieldProcess()
    service.configure()
    service.start()
    service.until("it judges", service.judges, 20.0)
    service.until("a call holds the rover", lambda: _called(service.status()), 120.0)
    before, old = service.status(), service.pid
    settings = (service.container.root / CONFIG).read_bytes()
    begun = time.monotonic()
    said = service.sh(f"{INSTALL} {shlex.quote('/own/' + wheel.name)}", timeout=_INSTALLS_WITHIN)
    seconds = round(time.monotonic() - begun, 1)
    service.until("the new one judges", lambda: service.judges(since=old), 20.0)
    after = service.status()
    for name in ("current_id", "words", "policy"):
        if after.get(name) != before.get(name):
            raise ContainerError(f"{name} was {before.get(name)}, and is {after.get(name)}: {said}")
    if (service.container.root / CONFIG).read_bytes() != settings:
        raise ContainerError("the update changed companion.toml")
    left = service.sh("ls /opt").split()
    if len(left) != 2:
        raise ContainerError(f"the update left more than one program in /opt: {left}")
    log = service.sh("journalctl -u companion --no-pager -o short-monotonic")
    ended = float(re.findall(r"\[ *([0-9.]+)\] .*told to stop, and stopped", log)[-1])
    ready = float(re.findall(r"\[ *([0-9.]+)\] .*Started companion.service", log)[-1])
    answered = answer(service.field.ground, "go", 30.0)
    closed = service.until(
        "the answered call ends", lambda: service.status().get("current_id") != before["current_id"], 30.0
    )
    return {
        "call": before["current_id"],
        "held_by": [before.get("held_by"), after.get("held_by")],
        "upgrade_s": seconds,
        "away_s": round(ready - ended, 2),
        "answer": answered,
        "closed_s": closed,
    }


def oak(service: Service) -> Figures:
    """Install the extra for OAK cameras: DepthAI works in the hardened unit, and finds no OAK."""
    begun = time.monotonic()
    service.sh(f"{INSTALL} 'anytraverse-companion[oak] @ file:///checkout'", timeout=_INSTALLS_WITHIN)
    seconds = round(time.monotonic() - begun, 1)
    path = service.container.root / CONFIG
    path.write_text(re.sub(r"(?m)^source = .*$", 'source = "oak:"', path.read_text()))
    service.sh("systemctl restart companion")
    told = service.until(
        "no OAK is told", lambda: "no OAK is there" in str(service.status().get("camera")), 30.0
    )
    size = int(service.sh("du -sm /opt/anytraverse/").split()[0])
    service.configure()
    service.sh("systemctl restart companion")
    service.until("it judges", service.judges, 20.0)
    return {"install_s": seconds, "told_s": told, "size_mb": size}


def uninstall(service: Service) -> Figures:
    """Remove it: first with settings and memory kept, then all of it."""
    service.sh("sh /checkout/systemd/install.sh --uninstall")
    root = service.container.root
    kept = (root / CONFIG).exists() and (root / STATE / "journal.db").exists()
    program = service.sh("find /opt /etc/systemd /etc/udev; ps -eo args | grep -v grep", check=False)
    service.sh("sh /checkout/systemd/install.sh --uninstall --purge")
    left = service.sh(_LEFT, check=False).split()
    if not kept or "anytraverse" in program or "companion" in program or left:
        raise ContainerError(f"kept: {kept}; still there: {program} {left}")
    return {"kept": kept, "left_after_purge": left}


def package(service: Service) -> Figures:
    """Build the Debian package; install, update, remove and purge it."""
    begun = time.monotonic()
    service.sh("cp -r /checkout /root/checkout")
    build = "cd /root/checkout && PIP_NO_INDEX=1 PIP_FIND_LINKS=/wheels sh .ci/deb.sh"
    build += " && mv dist/*.deb /root/first.deb"
    service.sh(build, timeout=_INSTALLS_WITHIN)
    built = round(time.monotonic() - begun, 1)
    first, second = "/root/first.deb", "/root/second.deb"
    service.sh(_NEWER, timeout=_INSTALLS_WITHIN)
    size = int(service.sh(f"du -m {first}").split()[0])
    begun = time.monotonic()
    service.sh(f"dpkg --install {first}", timeout=_INSTALLS_WITHIN)
    seconds = round(time.monotonic() - begun, 1)
    service.configure()
    service.sh("systemctl enable --now companion")
    service.until("the packaged one judges", service.judges, 20.0)
    changed = service.sh("dpkg --verify anytraverse-companion", check=False).splitlines()
    settings, old = (service.container.root / CONFIG).read_bytes(), service.pid
    service.sh(f"dpkg --install --force-confold {second}", timeout=_INSTALLS_WITHIN)
    service.until("the updated one judges", lambda: service.judges(since=old), 20.0)
    kept = (service.container.root / CONFIG).read_bytes() == settings
    service.sh("dpkg --remove anytraverse-companion", timeout=_INSTALLS_WITHIN)
    kept = kept and (service.container.root / STATE / "journal.db").exists()
    program = service.sh("ls /opt 2>/dev/null; ps -eo args | grep '[c]ompanion run'", check=False).split()
    service.sh("dpkg --purge anytraverse-companion")
    left = service.sh(_LEFT, check=False).split()
    if not kept or program or left or any(CONFIG not in line for line in changed):
        raise ContainerError(f"kept: {kept}; still there: {program} {left}; changed: {changed}")
    return {"build_s": built, "size_mb": size, "install_s": seconds, "left_after_purge": left}
