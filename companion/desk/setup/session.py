"""What the pages ask for, carried out on one draft: the draft, camera, map, link and autopilot together."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from anytraverse.regions import Box
from companion.cli_config import SERVICE
from companion.config import Config
from companion.config.rows import all_settings
from companion.desk.check.camera import check_camera, check_exposure, check_frames
from companion.desk.check.cameras import plugged_in
from companion.desk.check.rover import CheckedRover, Perceives, load_perceiver
from companion.desk.check.watching import CameraDelivery
from companion.desk.setup import driven, mount, parameters, policies, trial
from companion.desk.setup.draft import MOST, Draft
from companion.desk.setup.jobs import Job, Jobs
from companion.desk.setup.judging import LiveMap
from companion.desk.setup.listening import LONGEST, listen, ports
from companion.desk.setup.parameters import AskedAutopilot
from companion.desk.setup.preview import Preview, PreviewPicture
from companion.pages.requests import RequestError

_LISTED_WITHIN = 25.0
_PERCEIVER_WITHIN = 120.0


class SetupSession:
    """Somebody's visit. Any thread may use it; what takes seconds runs as a job."""

    def __init__(self, file: Path) -> None:
        """Raises ConfigError where the file has a problem."""
        self.draft = Draft(file)
        self.preview = Preview()
        self.map = LiveMap()
        self._read: AskedAutopilot | None = None
        self._perceives: tuple[object, Perceives] | None = None
        self.jobs = Jobs(
            {
                "cameras": Job(lambda _: _cameras(), _LISTED_WITHIN),
                "ports": Job(lambda _: ports(), _LISTED_WITHIN),
                "listen": Job(lambda told: listen(text(told, "url")), LONGEST + 5.0),
                "estimate": Job(lambda _: driven.estimate(self.draft.config), driven.LIMIT),
                "autopilot": Job(lambda _: self._autopilot(), parameters.READ_WITHIN),
                "parameter": Job(self._parameter, parameters.SET_WITHIN + 5.0),
                "policies": Job(lambda _: self._policies(), _PERCEIVER_WITHIN),
                "trial": Job(lambda _: trial.raise_test_call(file), trial.LIMIT + 5.0),
            }
        )

    def close(self) -> None:
        """Close the camera."""
        self.preview.close()

    def state(self) -> dict[str, Any]:
        """Return the draft and the values in force with it: JSON values."""
        config = self.draft.config
        return {
            **self.draft.document(),
            "settings": all_settings(config, self.draft.changes),
            "words": dict(config.words),
            "vocabulary": list(config.vocabulary),
            "running": policies.running(config),
            "next": next_steps(self.draft.file),
            "recorded": driven.is_recorded(config),
            **mount.ground(config, *self._driven(config)),
        }

    def change(self, told: Mapping[str, Any]) -> dict[str, Any]:
        """Change the draft, with what waits for these changes. Raises RequestError."""
        changes, waiting = told.get("changes"), told.get("waiting", {})
        if not isinstance(changes, dict) or not changes or len(changes) > MOST:
            raise RequestError(f"changes is an object of 1 to {MOST} settings")
        if not isinstance(waiting, dict):
            raise RequestError("waiting is an object of settings")
        taken, refused = self.draft.change(changes, waiting)
        return {**self.state(), "taken": taken, "refused": refused}

    def forget(self, _told: Mapping[str, Any]) -> dict[str, Any]:
        """Drop all changes."""
        self.draft.forget()
        return self.state()

    def write(self, _told: Mapping[str, Any]) -> dict[str, Any]:
        """Write the file."""
        self.draft.write()
        return self.state()

    def camera(self) -> dict[str, Any]:
        """Return what the draft's camera delivers; it is opened, and closed when nobody asks any more."""
        config = self.draft.config
        live = self.preview.ask(config.camera.source, config.camera_options, _roi(config))
        seen = live.seen
        rover = self._rover(config, seen)
        found = [] if seen.trouble else [*check_camera(rover), *check_frames(rover), *check_exposure(rover)]
        return {
            "number": live.number,
            "has_picture": bool(live.jpeg),
            "trouble": seen.trouble,
            "width": seen.width,
            "height": seen.height,
            "rate": seen.rate,
            "wanted_rate": config.camera.rate,
            "aspect": config.mount.aspect,
            "has_shape": bool(seen.width) and config.mount.has_shape(seen.width, seen.height),
            "rows": [one.row() for one in found],
        }

    @property
    def live(self) -> PreviewPicture:
        """The newest picture."""
        return self.preview.newest

    def drag(self, told: Mapping[str, Any]) -> dict[str, Any]:
        """Set height and tilt by a line that was dragged. Raises RequestError.

        While it is being dragged ("final" is not true) only the lines that would follow are told. "height",
        "tilt": typed, and not taken yet, since the other one was not known.
        """
        config, row = self.draft.config, number(told, "row", -1.0, 2.0)
        config = mount.mounted(
            config, height=typed(told, "height", mount.HEIGHTS), tilt=typed(told, "tilt", mount.TILTS)
        )
        height, tilt = mount.dragged(config, text(told, "line"), row)
        if told.get("final") is not True:
            return {"lines": mount.lines(mount.mounted(config, height=height, tilt=tilt))}
        taken, _ = self.draft.change({"mount.height": round(height, 3), "mount.tilt": round(tilt, 2)})
        return {**self.state(), "taken": taken}

    def judge(self, _told: Mapping[str, Any]) -> dict[str, Any]:
        """Judge the newest picture by the draft's words."""
        config = self.draft.config
        return self.map.judge(config, self.live, config.words)

    def _driven(self, config: Config) -> tuple[float | None, float]:
        """Return the autopilot's own speed, m/s, and how far it drives on in its hold mode, m."""
        read = self._asked(config)
        if read is None:
            return None, 0.0
        readings = read.readings(config)
        return readings.speed[1] if readings.speed else None, readings.overrun

    def _asked(self, config: Config) -> AskedAutopilot | None:
        """Return the autopilot that has told its parameters, None where the link is another one by now."""
        return self._read if self._read is not None and self._read.url == config.link.url else None

    def _rover(self, config: Config, seen: CameraDelivery) -> CheckedRover:
        rover = CheckedRover(config, str(self.draft.file), Path())
        rover.seen = seen
        return rover

    def _autopilot(self) -> dict[str, Any]:
        self._read = parameters.read(self.draft.config)
        return parameters.document(self.draft.config, self._read)

    def _parameter(self, told: Mapping[str, Any]) -> dict[str, Any]:
        """Set one parameter as it was proposed, and return all of them as they are then."""
        config, name = self.draft.config, text(told, "name")
        read = self._asked(config)
        if read is None:
            raise RequestError("read the autopilot's settings first")
        rows = parameters.document(config, read)["rows"]
        row = next((row for row in rows if row["name"] == name), None)
        before, after = number(told, "before", -1e9, 1e9), number(told, "after", -1e9, 1e9)
        if row is None or row["proposed"] != after:
            raise RequestError(f"nothing was written: that is no proposal for {name[:16]}: read again")
        read.interview.values[name] = parameters.set_one(config, read, name, before, after)
        return parameters.document(config, read)

    def _policies(self) -> list[dict[str, Any]]:
        config = self.draft.config
        wanted = config.perceiver, config.words, config.vocabulary, config.mount, config.roi, config.camera
        if self._perceives is None or self._perceives[0] != wanted:
            self._perceives = wanted, load_perceiver(config)
        return policies.document(
            str(self.draft.file), config, self.live.seen, self._perceives[1], self._asked(config)
        )


def next_steps(file: Path) -> list[tuple[str, str]]:
    """Return what comes after the file is written, and what to type for it.

    The service's companion is started by systemd: one that is run by hand has another journal.
    """
    named = shlex.quote(str(file))
    if str(file) != SERVICE:
        return [
            ("Check the file", f"companion config check {named}"),
            ("Check the rover", f"companion check {named}"),
            ("Start it", f"companion run {named}"),
        ]
    return [
        ("Check the rover", f"sudo companion check {named}"),
        ("Start it", "sudo systemctl restart companion"),
        ("Have it start at each boot", "sudo systemctl enable companion"),
    ]


def _cameras() -> list[dict[str, Any]]:
    return [
        {
            "name": found.name,
            "source": found.source,
            "why": found.why,
            "width": found.options.width,
            "height": found.options.height,
            "pixel_format": found.options.pixel_format,
        }
        for found in plugged_in()
    ]


def _roi(config: Config) -> Box:
    roi = config.roi
    return Box(roi.left, roi.top, roi.right, roi.bottom)


def text(told: Mapping[str, Any], name: str) -> str:
    """Return a text of a request. Raises RequestError."""
    value = told.get(name)
    if not isinstance(value, str) or not 0 < len(value) <= 1000:
        raise RequestError(f"{name} is a text of 1 to 1000 characters")
    return value


def number(told: Mapping[str, Any], name: str, low: float, high: float) -> float:
    """Return a number of a request. Raises RequestError."""
    value = told.get(name)
    if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
        raise RequestError(f"{name} is a number of {low:g} to {high:g}")
    return float(value)


def typed(told: Mapping[str, Any], name: str, limits: tuple[float, float]) -> float | None:
    """Return a number of a request, None without a right one."""
    try:
        return number(told, name, *limits)
    except RequestError:
        return None
