"""The camera's rows: real folders of pictures, and what a companion that runs says of its camera."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from companion.cameras import BadFrame, CameraError, Capture, NoFrameYet
from companion.config import load_config
from companion.desk.check import watching
from companion.desk.check.camera import check_camera, check_exposure, check_frames, check_infrared
from companion.desk.check.rover import CheckedRover, Perceives
from companion.desk.check.rules import CheckFinding, Verdict
from tests.companion.cameras.test_calibration import ROS

cv2 = pytest.importorskip("cv2")

CALIBRATED = 'calibration = "lens.yaml"\n'


def rover(
    folder: Path, more: str = "", camera: str = "", running: dict[str, Any] | None = None
) -> CheckedRover:
    path = folder / "companion.toml"
    path.write_text(
        '[web]\nlisten = ""\n[vehicle]\nfile = ""\n'
        f'[camera]\nsource = "folder:{folder}/pictures"\n{camera}\n{more}'
    )
    return CheckedRover(load_config(str(path)), str(path), folder, running)


def pictures(folder: Path, *images: Any) -> None:
    (folder / "pictures").mkdir()
    for number, image in enumerate(images or (painted(120),)):
        cv2.imwrite(str(folder / f"pictures/{number}.png"), image)


def painted(level: int, noise: int = 60) -> Any:
    """A picture of 64 x 36 pixels around a brightness, of 255."""
    drawn = np.random.default_rng(0).integers(-noise, noise + 1, (36, 64, 3))
    return np.clip(drawn + level, 0, 255).astype(np.uint8)


def only(findings: list[CheckFinding]) -> tuple[Verdict, str]:
    (finding,) = findings
    return finding.verdict, finding.text


@pytest.fixture(autouse=True)
def _soon(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(watching, "WATCHED", 0.3)
    monkeypatch.setattr(watching, "LONGEST", 0.3)


def test_a_camera_that_is_not_there_fails_and_says_where_it_was_looked_for(tmp_path: Path) -> None:
    verdict, text = only(check_camera(rover(tmp_path)))
    assert verdict is Verdict.FAIL
    assert f"{tmp_path}/pictures cannot be read" in text
    assert "[camera] source" in text


def test_a_first_picture_passes(tmp_path: Path) -> None:
    pictures(tmp_path)
    verdict, text = only(check_camera(rover(tmp_path)))
    assert verdict is Verdict.PASS
    assert "64 x 36" in text


def test_a_picture_that_a_calibration_rectifies_is_told_so(tmp_path: Path) -> None:
    pictures(tmp_path)
    (tmp_path / "lens.yaml").write_text(ROS.replace("480", "360").replace("236.75", "176.75"))
    verdict, text = only(check_camera(rover(tmp_path, "[mount]\nheight = 1.0\ntilt = 10.0\n", CALIBRATED)))
    assert verdict is Verdict.PASS
    assert text.endswith("64 x 36, rectified")


def test_pictures_of_another_shape_than_the_calibration_s_fail(tmp_path: Path) -> None:
    pictures(tmp_path)
    (tmp_path / "lens.yaml").write_text(ROS)
    verdict, text = only(check_camera(rover(tmp_path, camera=CALIBRATED)))
    assert verdict is Verdict.FAIL
    assert "the pictures are 64 x 36, and the calibration is of 640 x 480: calibrate in the shape" in text


def test_pictures_that_are_all_torn_fail(tmp_path: Path) -> None:
    (tmp_path / "pictures").mkdir()
    (tmp_path / "pictures/1.jpg").write_bytes(b"torn")
    verdict, text = only(check_camera(rover(tmp_path)))
    assert verdict is Verdict.FAIL
    assert "torn or no picture" in text


def test_a_picture_of_another_shape_than_the_mount_s_is_told_with_the_figure_to_set(tmp_path: Path) -> None:
    pictures(tmp_path)
    mount = "[mount]\nheight = 1.0\ntilt = 10.0\n"
    verdict, text = only(check_camera(rover(tmp_path, mount)))
    assert verdict is Verdict.WARN
    assert "aspect is 1.333: set it to 1.778" in text
    assert only(check_camera(rover(tmp_path, mount + "aspect = 1.778\n")))[0] is Verdict.PASS


@pytest.mark.parametrize(
    ("said", "verdict", "text"),
    [
        ({"camera": {"state": "delivering", "reason": ""}}, Verdict.PASS, "delivering"),
        ({"camera": {"state": "failed", "reason": "no cable"}}, Verdict.FAIL, "no cable"),
        ({"camera": {"state": "ended", "reason": "the last picture"}}, Verdict.FAIL, "the last picture"),
        ({"camera": {"state": "connecting"}}, Verdict.WARN, "wait"),
        ({}, Verdict.WARN, "unknown"),
    ],
)
def test_a_running_companion_s_camera_is_left_to_it(
    tmp_path: Path, said: dict[str, Any], verdict: Verdict, text: str
) -> None:
    found = only(check_camera(rover(tmp_path, running=said)))
    assert (found[0], text in found[1]) == (verdict, True)
    assert only(check_exposure(rover(tmp_path, running=said)))[0] is Verdict.SKIP


class Played:
    """A camera and its clock: a picture every `period` seconds, `age` old; every `bad`th one is damaged.

    pictures: after so many none comes any more. lost: then it fails.
    """

    def __init__(
        self, period: float, age: float, bad: int = 0, pictures: int = 999, *, lost: bool = False
    ) -> None:
        self.now, self._period, self._age, self._bad, self._reads = 50.0, period, age, bad, 0
        self._pictures, self._lost = pictures, lost

    def monotonic(self) -> float:
        """As time.monotonic."""
        return self.now

    def read(self, timeout: float) -> Capture:
        """As of any camera."""
        if self._reads >= self._pictures:
            self.now += timeout
            raise CameraError("unplugged") if self._lost else NoFrameYet("none")
        self.now += self._period
        self._reads += 1
        if self._bad and self._reads % self._bad == 0:
            raise BadFrame("torn")
        return Capture(self.now - self._age, painted(120))

    def close(self) -> None:
        """As of any camera."""


@pytest.mark.parametrize(
    ("played", "verdicts", "told"),
    [
        (Played(0.1, 0.03), [Verdict.PASS], "10.0 frames/s, 30 ms old when they come"),
        (Played(0.2, 0.03), [Verdict.WARN], "5.0 frames/s, 30 ms old when they come: [camera] rate is 10: "),
        (Played(0.1, 2.0), [Verdict.FAIL], "more than T, 1 s"),
        (Played(0.1, 0.03, bad=3), [Verdict.WARN, Verdict.WARN], "6.7 frames/s"),
        (Played(0.04, 0.03, bad=5), [Verdict.PASS, Verdict.WARN], "20.1 frames/s"),
        (Played(0.1, 0.03, pictures=1), [Verdict.FAIL], "0.0 frames/s"),
        (Played(0.1, 0.03, pictures=3), [Verdict.FAIL], "0.6 frames/s"),
    ],
)
def test_rate_and_age_are_measured(
    tmp_path: Path, played: Played, verdicts: list[Verdict], told: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(watching, "WATCHED", 3.0)
    monkeypatch.setattr(watching, "LONGEST", 3.0)
    monkeypatch.setattr(watching, "time", played)
    monkeypatch.setattr(watching, "open_camera", lambda *_: played)
    found = check_frames(rover(tmp_path, '[call]\npolicy = "hold"'))
    assert [finding.verdict for finding in found] == verdicts
    assert told in found[0].text
    if len(found) > 1:
        assert "pictures were damaged: check cable and supply" in found[1].text


def test_a_camera_that_is_lost_while_it_is_watched_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    played = Played(0.1, 0.03, pictures=2, lost=True)
    monkeypatch.setattr(watching, "time", played)
    monkeypatch.setattr(watching, "open_camera", lambda *_: played)
    assert only(check_camera(rover(tmp_path))) == (Verdict.FAIL, "unplugged")


def test_of_one_picture_no_rate_is_known(tmp_path: Path) -> None:
    pictures(tmp_path)
    assert only(check_frames(rover(tmp_path)))[0] is Verdict.SKIP


@pytest.mark.parametrize(
    ("policy", "rate", "latency", "verdict", "told"),
    [
        ("hold", 10.0, 90.0, Verdict.PASS, "10.0 frames/s, 90 ms old when judged"),
        ("hold", 0.4, 90.0, Verdict.FAIL, "T is 1 s, so that each is too old before the next one comes"),
        ("report", 0.4, 90.0, Verdict.WARN, "T is 1 s, so that each is too old"),
        ("hold", 0.0, 90.0, Verdict.FAIL, "too old"),
        ("hold", 10.0, 1200.0, Verdict.FAIL, "more than T, 1 s: find what delays them"),
        ("hold", 10.0, 600.0, Verdict.WARN, "over half of T, 1 s"),
        ("hold", 5.0, 90.0, Verdict.WARN, "or set rate = 5.0"),
        ("hold", None, 90.0, Verdict.SKIP, "not known yet"),
        ("hold", 10.0, None, Verdict.SKIP, "not known yet"),
    ],
)
def test_the_frames_of_a_companion_that_runs_are_judged_by_what_it_says(
    tmp_path: Path, policy: str, rate: float | None, latency: float | None, verdict: Verdict, told: str
) -> None:
    said = {"camera": {"rate": rate}, "latency_ms": latency}
    found = only(check_frames(rover(tmp_path, f'[call]\npolicy = "{policy}"', running=said)))
    assert (found[0], told in found[1]) == (verdict, True), found


@pytest.mark.parametrize(
    ("image", "verdict", "told"),
    [
        (painted(120), Verdict.PASS, "brightness 120 of 255, 0 % white"),
        (painted(12, 14), Verdict.WARN, "more light, or a longer exposure"),
        (painted(280), Verdict.WARN, "a shorter exposure"),
        (painted(8, 2), Verdict.FAIL, "picture underexposed: switch on a light"),
        (painted(0, 1), Verdict.FAIL, "picture black: take the cap off the lens"),
        (painted(280, 20), Verdict.FAIL, "picture overexposed: turn the camera out of the sun"),
        (painted(120, 0), Verdict.WARN, "is the lens covered?"),
    ],
)
def test_dark_white_and_plain_pictures_are_told(
    tmp_path: Path, image: Any, verdict: Verdict, told: str
) -> None:
    pictures(tmp_path, image)
    found = only(check_exposure(rover(tmp_path)))
    assert (found[0], told in found[1]) == (verdict, True), found


def test_exposure_is_judged_in_the_region_of_interest(tmp_path: Path) -> None:
    image = painted(120)
    image[24:34, 40:60] = 255
    pictures(tmp_path, image)
    assert only(check_exposure(rover(tmp_path)))[0] is Verdict.PASS
    aside = "[roi]\nleft = 0.64\nright = 0.92\ntop = 0.7\nbottom = 0.92"
    verdict, told = only(check_exposure(rover(tmp_path, aside)))
    assert (verdict, "picture overexposed" in told) == (Verdict.FAIL, True)


def test_of_a_camera_that_is_not_there_nothing_more_is_told(tmp_path: Path) -> None:
    absent = rover(tmp_path)
    assert only(check_camera(absent))[0] is Verdict.FAIL
    assert [only(check(absent))[0] for check in (check_frames, check_exposure)] == [Verdict.SKIP] * 2


PINK, GREEN = (125, 90, 150), (60, 110, 90)
"""Plants by a camera without and with an infrared filter: blue, green, red, as OpenCV writes them."""


def meadow(colour: tuple[int, int, int]) -> Any:
    return np.clip(painted(0, 10).astype(int) + np.array(colour), 0, 255).astype(np.uint8)


def noir(
    folder: Path, monkeypatch: pytest.MonkeyPatch, more: str = "", camera: str = "", *, trained: bool = False
) -> tuple[Verdict, str]:
    pictures(folder, meadow(PINK))
    found = rover(folder, more, camera)
    monkeypatch.setattr("companion.desk.check.rover.load_perceiver", lambda _: Perceives(infrared=trained))
    return only(check_infrared(found))


def test_a_camera_with_an_infrared_filter_passes(tmp_path: Path) -> None:
    pictures(tmp_path, meadow(GREEN))
    assert only(check_infrared(rover(tmp_path))) == (Verdict.PASS, "the camera shows none")


def test_a_camera_without_an_infrared_filter_is_told_with_what_to_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    verdict, text = noir(tmp_path, monkeypatch)
    assert verdict is Verdict.WARN
    assert "NoIR" in text
    assert '[camera] infrared = "handle"' in text


def test_it_is_a_reason_not_to_drive_where_the_policy_is_hold(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hold = '[call]\npolicy = "hold"\n[stopping]\nunchecked = true\n'
    assert noir(tmp_path, monkeypatch, hold)[0] is Verdict.FAIL


@pytest.mark.parametrize(
    ("camera", "trained", "verdict"),
    [
        ('infrared = "handle"', False, Verdict.PASS),
        ('infrared = "auto"', True, Verdict.PASS),
        ('infrared = "auto"', False, Verdict.WARN),
        ('infrared = "refuse"', True, Verdict.WARN),
    ],
)
def test_it_passes_where_perceiver_or_configuration_handle_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, camera: str, trained: bool, verdict: Verdict
) -> None:
    assert noir(tmp_path, monkeypatch, "", camera, trained=trained)[0] is verdict


def test_a_dark_picture_or_none_says_nothing_of_infrared(tmp_path: Path) -> None:
    assert only(check_infrared(rover(tmp_path)))[0] is Verdict.SKIP
    pictures(tmp_path, painted(0, 4))
    verdict, text = only(check_infrared(rover(tmp_path)))
    assert (verdict, "too dark" in text) == (Verdict.SKIP, True)


@pytest.mark.parametrize(
    ("shown", "trained", "verdict"),
    [
        (None, False, Verdict.SKIP),
        (False, False, Verdict.PASS),
        (True, False, Verdict.WARN),
        (True, True, Verdict.PASS),
    ],
)
def test_a_companion_that_runs_is_asked_what_it_saw(
    tmp_path: Path, shown: bool | None, trained: bool, verdict: Verdict
) -> None:
    said = {"camera": {"infrared": shown}, "perceiver": {"infrared": trained}}
    assert only(check_infrared(rover(tmp_path, running=said)))[0] is verdict
