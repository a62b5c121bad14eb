"""Defines every setting: its default, allowed values and meaning. config/companion.toml describes them, too.

Where the default is None, the meaning says what applies then.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

from anytraverse.frame import Intrinsics
from anytraverse.ground import WIDEST, GroundCamera, Lens
from anytraverse.perception import KINDS, NAMED
from anytraverse.perception.runtime import PRECISIONS, PROVIDERS, Runtime
from anytraverse.preferences import Preferences
from companion.cameras import CameraOptions, split_source
from companion.cameras.calibration import LensCalibration
from companion.cameras.pixel_formats import MJPEG, PIXEL_FORMATS, frame_bytes
from companion.cameras.shown import is_like_a_url, shown
from companion.config.checks import (
    Conflict,
    Section,
    checked,
    choice,
    flag,
    harmless,
    listing,
    number,
    path,
    setting,
    whole,
)
from companion.config.radio import LinkSection
from companion.config.video import VideoSection
from companion.config.web import AlertSection, LiveSection, WebSection
from companion.vehicle import PX4_HOLDS

LONGEST_FRESHNESS = 10.0
_ASPECT_OFF = 0.02
"""Share by which a picture's shape may differ from [mount] aspect."""
MOST_SCENES = 10_000
"""The most that a memory holds, wherever it comes from."""
SMALLEST_RING = 20
"""MB of the recordings, at least: eight files, each of which takes some frames."""


@dataclass(frozen=True)
class CameraSection(Section):
    """Where frames come from."""

    source: str = setting("folder:pictures", checked(split_source, harmless), "kind:place of the camera")
    rate: float = setting(10.0, number(0.5, 60), "frames/s that the companion aims to judge")
    playback: float | None = setting(
        None, number(0.5, 240), "frames/s of a video or folder; unset: the video's own, 10 for a folder"
    )
    loop: bool = setting(False, flag, "whether a video or folder starts again at its end")  # noqa: FBT003
    view: float = setting(60.0, number(10, 180), "horizontal field of view, degrees")
    calibration: str | None = setting(
        None,
        path,
        "file of the lens's calibration, by which pictures are rectified, and which sets view; unset: none",
    )
    latency: float = setting(
        0.15, number(0, 5), "s from exposure to arrival of a frame, where the camera does not report it"
    )
    width: int | None = setting(None, whole(16, 8192), "pixels of a picture; unset: as the camera says")
    height: int | None = setting(None, whole(16, 8192), "pixels of a picture; unset: as the camera says")
    pixel_format: str | None = setting(
        None, choice(*PIXEL_FORMATS, MJPEG), "what a pipe sends, or v4l2 is asked for; unset: as v4l2 says"
    )
    fps: float | None = setting(
        None, number(0.5, 240), "frames/s that a v4l2 or oak camera is asked for; unset: its own"
    )
    exposure: float | None = setting(
        None, number(0, 1, above=True), "exposure time of a v4l2 camera in s; unset: automatic"
    )
    depth: bool = setting(False, flag, "whether an oak camera measures depth, too")  # noqa: FBT003
    infrared: str = setting(
        "auto",
        choice("auto", "handle", "refuse"),
        "a camera that shows infrared (NoIR): handle it, refuse policy hold, or as the perceiver is trained",
    )

    def with_paths_in(self, folder: Path) -> CameraSection:
        """Return these settings with a relative path of the calibration resolved against `folder`."""
        if self.calibration is None:
            return self
        return replace(self, calibration=str(folder / os.path.expanduser(self.calibration)))

    def handles_infrared(self, *, trained: bool) -> bool:
        """Whether policy hold is allowed with a NoIR camera. trained: whether the perceiver is, for that."""
        return trained if self.infrared == "auto" else self.infrared == "handle"

    def conflicts(self) -> Iterator[Conflict]:
        if (self.width is None) != (self.height is None):
            yield ("width", "height"), "width and height go together: give both"
        if self.depth and not self.source.startswith("oak:"):
            yield ("depth",), 'only an oak camera measures depth: remove it, or set source = "oak:"'
        if self.source.startswith("pipe:"):
            try:
                frame_bytes(self.pixel_format, self.width, self.height)
            except ValueError as error:
                yield ("source",), str(error)


def _known_perceiver(name: str) -> None:
    kind, _, place = name.partition(":")
    if kind not in KINDS:
        raise ValueError(f"no perceiver is called that: begin with one of {', '.join(KINDS)}")
    if is_like_a_url(place):
        raise ValueError("give a bundle's folder on this computer")


def _shown_perceiver(name: object) -> str | None:
    return shown(name, KINDS) if isinstance(name, str) else None


@dataclass(frozen=True)
class PerceiverSection(Section):
    """Which perceiver turns words and frames into maps, and how its networks run."""

    name: str = setting(
        "builtin", checked(_known_perceiver, _shown_perceiver), "kind, or kind:folder of its bundle"
    )
    providers: tuple[str, ...] = setting(
        ("CPU",),
        listing(choice(*PROVIDERS), 1, len(PROVIDERS)),
        "execution providers of ONNX Runtime for networks, the preferred one first",
    )
    threads: int = setting(0, whole(0, 256), "CPU cores that networks may use, 0: all")
    precision: str = setting("auto", choice(*PRECISIONS), "the bundle's variant: auto, fp32 or int8")
    scene_every: int = setting(1, whole(1, 100), "frames from one embedding of the scene to the next")

    @property
    def runtime(self) -> Runtime:
        """The settings of ONNX Runtime."""
        return Runtime(self.providers, self.threads, self.precision)

    def with_paths_in(self, folder: Path) -> PerceiverSection:
        """Return these settings with a relative path in `name` resolved against `folder`."""
        kind, colon, argument = self.name.partition(":")
        if not argument or self.name in NAMED:
            return self
        return replace(self, name=f"{kind}{colon}{folder / os.path.expanduser(argument)}")


@dataclass(frozen=True)
class VehicleSection(Section):
    """Which vehicle's file is merged into this one."""

    file: str = setting("vehicles/rover.toml", path, 'the vehicle\'s file, relative to this one; "" for none')


@dataclass(frozen=True)
class MountSection(Section):
    """Where the camera is mounted. Without it, it is unknown whether the vehicle stops in time."""

    height: float | None = setting(None, number(0.05, 20), "height of the lens above the ground, m")
    tilt: float | None = setting(None, number(-45, 85), "angle of the lens axis below the horizon, degrees")
    aspect: float = setting(1.333, number(0.3, 5), "the picture's width divided by its height")
    front: float = setting(0.0, number(0, 20), "distance from the lens forward to the vehicle's front, m")
    heading: float = setting(
        0.0, number(-180, 180), "direction in which it looks, degrees clockwise from the vehicle's nose"
    )
    roll: float = setting(0.0, number(-45, 45), "turn about the lens axis, degrees, right side down: above 0")
    width: float | None = setting(
        None, number(0.1, 10), "the vehicle's width, m; with it the region of interest is one in metres"
    )

    def has_shape(self, width: int, height: int) -> bool:
        """Whether pictures of so many pixels have the shape that `aspect` says."""
        return abs(width / height / self.aspect - 1.0) <= _ASPECT_OFF

    def conflicts(self) -> Iterator[Conflict]:
        if (self.height is None) != (self.tilt is None):
            yield ("height", "tilt"), "height and tilt go together: give both"


@dataclass(frozen=True)
class StoppingSection(Section):
    """How fast the vehicle drives by itself, and how it stops."""

    speed: float | None = setting(
        None, number(0.05, 30), "the fastest speed that it is commanded to drive by itself, m/s"
    )
    time_constant: float | None = setting(
        None,
        number(0, 20),
        "s, from `companion check --measure`; unset: 2.1 s, or braking alone where that is longer",
    )
    braking: float = setting(
        0.5, number(0.01, 100), "deceleration in HOLD besides the time constant, m/s2, measured"
    )
    hold_by: str = setting(
        "hold",
        choice("hold", "brake"),
        "hold, or brake: out of AUTO the script on an ArduPilot brakes in GUIDED before it sets HOLD",
    )
    brake_time_constant: float | None = setting(
        None, number(0, 20), "s, of that brake, from `companion check --measure`; unset: it may brake for 4 s"
    )
    brake_braking: float | None = setting(
        None, number(0.01, 100), "deceleration of that brake besides its time constant, m/s2, measured"
    )
    delay: float = setting(0.5, number(0, 10), "s from a hold command until the autopilot has accepted it")
    unchecked: bool = setting(
        False,  # noqa: FBT003
        flag,
        "whether policy hold is allowed although it is unknown whether the vehicle stops in time",
    )

    def conflicts(self) -> Iterator[Conflict]:
        if (self.brake_time_constant is None) is not (self.brake_braking is None):
            yield (
                ("brake_time_constant", "brake_braking"),
                "brake_time_constant and brake_braking are measured together: set both",
            )


@dataclass(frozen=True)
class RoiSection(Section):
    """The region of interest: in metres where mount and vehicle's width are known, else in fractions.

    Fractions are of the image's width and height.
    """

    left: float = setting(0.333, number(0, 1), "left side")
    top: float = setting(0.6, number(0, 1), "upper side")
    right: float = setting(0.667, number(0, 1), "right side")
    bottom: float = setting(0.95, number(0, 1), "lower side")
    tile_share: float | None = setting(
        None,
        number(0.05, 1),
        "side of a tile as a fraction of the ROI's width; unset: calculated from mount and speed where these "
        "are set, else the perceiver's own",
    )

    near: float = setting(0.3, number(0, 5), "m from the vehicle's front to the region, with a mount")
    far: float | None = setting(
        None, number(0.5, 6), "m from the vehicle's front to its far side; unset: by what stopping needs"
    )
    width: float | None = setting(None, number(0.2, 10), "its width, m; unset: the vehicle's and 0.6 m")

    def conflicts(self) -> Iterator[Conflict]:
        if self.far is not None and self.near >= self.far:
            yield ("near", "far"), f"near {self.near:g} must be less than far {self.far:g}"
        if self.left >= self.right:
            yield ("left", "right"), f"left {self.left:g} must be less than right {self.right:g}"
        if self.top >= self.bottom:
            yield ("top", "bottom"), f"top {self.top:g} must be less than bottom {self.bottom:g}"


@dataclass(frozen=True)
class CorridorSection(Section):
    """The vehicle's width as it appears at two rows of the image, in fractions of the image's width."""

    bottom: float = setting(0.3, number(0, 1, above=True), "at the lower row")
    top: float = setting(0.2, number(0, 1, above=True), "at the upper row")
    bottom_row: float = setting(0.95, number(0, 1), "the lower row, as a fraction of the image's height")
    top_row: float = setting(0.6, number(0, 1), "the upper row, as a fraction of the image's height")

    def conflicts(self) -> Iterator[Conflict]:
        if self.top_row >= self.bottom_row:
            yield (
                ("top_row", "bottom_row"),
                f"top_row {self.top_row:g} must be less than bottom_row {self.bottom_row:g}",
            )


@dataclass(frozen=True)
class ThresholdsSection(Section):
    """The limits from which a figure counts as bad. Unset: the perceiver's own."""

    roi: float | None = setting(
        None, number(0, 1, above=True), "mean uncertainty of the ROI above which something is unknown"
    )
    scene: float | None = setting(
        None, number(-1, 1), "cosine to the reference scene below which the scene is new"
    )
    tile: float | Literal["off"] | None = setting(
        None,
        number(0, 1, above=True, word="off"),
        'uncertainty of the worst tile above which something is unknown; "off": not judged',
    )
    trav: float = setting(
        0.4, number(0, 1), "drivable share of the ROI's known ground below which the way is blocked"
    )


@dataclass(frozen=True)
class CallSection(Section):
    """When the operator is called, and what the companion may do to the vehicle."""

    policy: str = setting(
        "report", choice("report", "shadow", "hold", "guide"), "report, shadow, hold or guide"
    )
    off_channel: int = setting(0, whole(0, 18), "RC channel that switches calls and holds off, 0: none")
    off_side: str = setting(
        "high", choice("high", "low"), "the end of the channel that means off: high or low"
    )
    votes: int = setting(2, whole(1, 60), "a reason counts after this many bad frames ...")
    window: int = setting(3, whole(1, 60), "... of the last this many")
    margin: float = setting(
        0.03, number(0, 0.5), "a figure is good again this far on the good side of its threshold"
    )
    similarity_margin: float = setting(0.01, number(0, 0.5), "the same margin, for the scene's cosine")
    ok_frames: int = setting(5, whole(1, 600), "OK frames in a row before the vehicle resumes")
    passed_after: float = setting(
        5.0, number(0, 600), "s without its reasons after which a call that holds nothing is closed"
    )
    accepted_for: float = setting(20.0, number(1, 600), "s for which a go or a mode by hand accepts")
    accepted_distance: float = setting(10.0, number(0.5, 1000), "m for which a go or a mode by hand accepts")
    accepted_rise: float = setting(
        0.1, number(0, 1), "rise of the mean uncertainty above the accepted one that ends it"
    )
    go_lasts: float = setting(60.0, number(1, 600), "s that a go waits for OK frames")
    freshness: float | None = setting(
        None,
        number(0.2, LONGEST_FRESHNESS),
        "s after which a frame is too old; unset: 3 frame periods, at least 1, at most 2",
    )
    fault_ends_hold: bool = setting(False, flag, "whether a fault's hold may end by itself")  # noqa: FBT003
    px4_hold: str = setting("loiter", choice(*PX4_HOLDS), "how a PX4 rover is held: loiter or offboard")
    px4_deadman: str = setting(
        "off",
        choice("off", "manual_control"),
        "what stops a PX4 rover when this computer dies: off (nothing), or the end of a stream of sticks",
    )

    @property
    def holds(self) -> bool:
        """Whether the configured policy may hold the vehicle."""
        return self.policy in ("hold", "guide")

    def conflicts(self) -> Iterator[Conflict]:
        if self.off_channel and self.px4_deadman != "off":
            yield (
                ("px4_deadman", "off_channel"),
                "a transmitter with an off switch, and a stream of sticks for which PX4 ignores it, exclude "
                "each other: set one of them to off",
            )
        if self.votes > self.window:
            yield ("votes", "window"), f"votes {self.votes} must be at most window {self.window}"


@dataclass(frozen=True)
class GuideSection(Section):
    """How the companion drives an ArduPilot rover round what leaves room, with policy guide."""

    corridor: float = setting(
        2.0, number(0.5, 10), "m to each side of the mission's way that it may be left by"
    )
    radius: float | None = setting(
        None, number(0.2, 30), "radius of the vehicle's tightest turn, m; without it nothing is driven round"
    )


@dataclass(frozen=True)
class JournalSection(Section):
    """Where data is stored that must survive a restart."""

    folder: str | None = setting(
        None, path, "folder; unset: $STATE_DIRECTORY under systemd, else ~/.local/state/anytraverse"
    )
    scenes: int = setting(256, whole(1, MOST_SCENES), "answered scenes that are stored")

    def with_paths_in(self, folder: Path) -> JournalSection:
        """Return these settings with a relative path resolved against `folder`."""
        if not self.folder:
            return self
        return replace(self, folder=str(folder / os.path.expanduser(self.folder)))

    @property
    def path(self) -> Path:
        """The folder in use."""
        given = self.folder or os.environ.get("STATE_DIRECTORY", "").split(":")[0]
        return Path(os.path.expanduser(given or "~/.local/state/anytraverse"))


@dataclass(frozen=True)
class PicturesSection(Section):
    """Which pictures are stored for later."""

    keep: int = setting(50, whole(0, 10_000), "pictures of calls that are stored")


@dataclass(frozen=True)
class RecordingSection(Section):
    """What is recorded, for later: frames, maps, assessments, calls, answers, vehicle, log."""

    size: int = setting(1000, whole(0, 1_000_000), "MB of all recordings together, 0: nothing is recorded")
    rate: float = setting(
        1.0, number(0.01, 60), "frames/s in the recordings and the live view; assessments are all in them"
    )

    def conflicts(self) -> Iterator[Conflict]:
        if 0 < self.size < SMALLEST_RING:
            yield ("size",), f"give 0, or at least {SMALLEST_RING}"

    @property
    def most(self) -> int:
        """The size in bytes."""
        return self.size * 1_000_000


SECTIONS: Mapping[str, type[Section]] = {
    "camera": CameraSection,
    "perceiver": PerceiverSection,
    "vehicle": VehicleSection,
    "mount": MountSection,
    "stopping": StoppingSection,
    "roi": RoiSection,
    "corridor": CorridorSection,
    "thresholds": ThresholdsSection,
    "call": CallSection,
    "guide": GuideSection,
    "link": LinkSection,
    "journal": JournalSection,
    "pictures": PicturesSection,
    "recording": RecordingSection,
    "live": LiveSection,
    "web": WebSection,
    "video": VideoSection,
    "alert": AlertSection,
}
WORD_KEYS: Mapping[str, str] = {
    "vocabulary": "words offered to ground stations",
    "words": "word -> weight",
    "aliases": "word -> its parameter's name less AT_W_",
}
"""What is of words, beside the sections, and its meaning."""
OF_A_VEHICLE = (*WORD_KEYS, "mount", "stopping", "roi", "corridor", "thresholds", "call")
"""The tables that a vehicle's file may have. companion.toml may have them, too, and its values win."""


@dataclass(frozen=True)
class Config:
    """The whole configuration.

    words: word -> weight in [-1, 1], in force at the first start. vocabulary: these words, and the other ones
    that are offered to ground stations as parameters. aliases: word -> its parameter's name without AT_W_.
    calibration: what the file of [camera] calibration says; view and aspect are then those of the rectified
    picture.
    """

    camera: CameraSection = field(default_factory=CameraSection)
    perceiver: PerceiverSection = field(default_factory=PerceiverSection)
    vehicle: VehicleSection = field(default_factory=VehicleSection)
    words: Mapping[str, float] = field(default_factory=dict)
    vocabulary: tuple[str, ...] = ()
    aliases: Mapping[str, str] = field(default_factory=dict)
    mount: MountSection = field(default_factory=MountSection)
    stopping: StoppingSection = field(default_factory=StoppingSection)
    roi: RoiSection = field(default_factory=RoiSection)
    corridor: CorridorSection = field(default_factory=CorridorSection)
    thresholds: ThresholdsSection = field(default_factory=ThresholdsSection)
    call: CallSection = field(default_factory=CallSection)
    guide: GuideSection = field(default_factory=GuideSection)
    link: LinkSection = field(default_factory=LinkSection)
    journal: JournalSection = field(default_factory=JournalSection)
    pictures: PicturesSection = field(default_factory=PicturesSection)
    recording: RecordingSection = field(default_factory=RecordingSection)
    live: LiveSection = field(default_factory=LiveSection)
    web: WebSection = field(default_factory=WebSection)
    video: VideoSection = field(default_factory=VideoSection)
    alert: AlertSection = field(default_factory=AlertSection)
    calibration: LensCalibration | None = None

    @property
    def intrinsics(self) -> Intrinsics | None:
        """The lens of the rectified picture: fx over its width, fy over its height, cx, cy; None: unknown.

        cx and cy are where the lens axis is, the edges of the picture being 0 and 1.
        """
        return None if self.calibration is None else self.calibration.rectified

    @property
    def preferences(self) -> Preferences:
        """The configured words."""
        return Preferences.of(self.words)

    @property
    def camera_options(self) -> CameraOptions:
        """How the camera is opened."""
        camera = self.camera
        return CameraOptions(
            playback=camera.playback,
            loop=camera.loop,
            width=camera.width,
            height=camera.height,
            pixel_format=camera.pixel_format,
            fps=camera.fps,
            exposure=camera.exposure,
            latency=camera.latency,
            freshness=self.freshness,
            depth=camera.depth,
            calibration=self.calibration,
        )

    @property
    def ground_camera(self) -> GroundCamera | None:
        """The camera above the ground; None where its mount is not set, or its view is no pinhole's."""
        mount = self.mount
        if mount.height is None or mount.tilt is None or self.camera.view > WIDEST:
            return None
        lens = Lens.of_view(self.camera.view, mount.aspect)
        return GroundCamera(lens, mount.height, mount.tilt, mount.front, mount.roll, mount.heading)

    @property
    def freshness(self) -> float:
        """The freshness limit T in s: 3 frame periods, at least 1 and at most 2, unless configured."""
        return self.call.freshness or min(2.0, max(1.0, 3.0 / self.camera.rate))
