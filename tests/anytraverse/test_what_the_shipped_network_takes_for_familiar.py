"""What the shipped network takes for a known place: other frames of the drive, and no covered lens."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from anytraverse.assessment import Reason
from anytraverse.engine import AnyTraverse
from anytraverse.frame import Frame, Image
from anytraverse.judging import Settings
from anytraverse.look import read_picture
from anytraverse.memory import first_memory
from anytraverse.perception import make_perceiver
from anytraverse.perception.runtime import Runtime
from anytraverse.preferences import Preferences

cv2 = pytest.importorskip("cv2")
pytest.importorskip("onnxruntime")

DATA = Path(__file__).parents[3] / "shared" / "data"
DRIVE = sorted(DATA.glob("trail/02[0-6]?.jpg"))[::4]
"""Frames of a drive on which nothing was trained."""
pytestmark = pytest.mark.skipif(
    not DRIVE, reason="needs the labelled frames beside the checkout: ../shared/data"
)


class Taught:
    """A rover that has seen three places of the drive, and was answered at two of them."""

    def __init__(self) -> None:
        perceiver = make_perceiver("builtin", Runtime(threads=1))
        words = Preferences.parse("trail: 1; grass: 1; bush: -1; tree: -1")
        self.engine = AnyTraverse(
            perceiver, Settings.of(perceiver.defaults), first_memory(perceiver.model_id, words)
        )
        self._frames = 0
        for number, path in enumerate(DRIVE[::6][:3]):
            frame = self._frame(read_picture(str(path)))
            self.engine.step(frame, frame.captured_at)
            if number:
                call = self.engine.newest
                self.engine.answer((), frame.captured_at, call=call, call_id=number, go=True)

    def calls(self, image: Image) -> bool:
        """Whether a frame shows a new place."""
        frame = self._frame(image)
        return Reason.UNKNOWN_SCENE in self.engine.step(frame, frame.captured_at).reasons

    def _frame(self, image: Image) -> Frame:
        self._frames += 1
        return Frame(self._frames, float(self._frames), image)


@pytest.fixture(scope="module")
def rover() -> Taught:
    return Taught()


def test_most_other_frames_of_the_drive_show_no_new_place(rover: Taught) -> None:
    new = [rover.calls(read_picture(str(path))) for path in DRIVE]
    assert len(new) >= 10
    assert np.mean(new) < 0.25


def test_frames_of_other_regions_and_cameras_show_a_new_place(rover: Taught) -> None:
    foreign = sorted([*DATA.glob("abroad/*/*.jpg"), *DATA.glob("frames/*.jpg")])[::3]
    new = [rover.calls(read_picture(str(path))) for path in foreign]
    assert len(new) >= 15
    assert np.mean(new) > 0.85


@pytest.mark.parametrize("grey", [30, 60, 90, 120, 160, 200])
def test_a_covered_lens_shows_a_new_place(rover: Taught, grey: int) -> None:
    noise = np.random.default_rng(grey).normal(0, 6, (340, 640, 3))
    assert rover.calls(np.clip(grey + noise, 0, 255).astype(np.uint8))
    assert rover.calls(np.full((340, 640, 3), grey, np.uint8))


@pytest.mark.parametrize("path", DRIVE[::5], ids=lambda path: path.stem)
def test_a_picture_out_of_focus_and_one_half_covered_show_a_new_place(rover: Taught, path: Path) -> None:
    image = read_picture(str(path))
    assert rover.calls(np.asarray(cv2.GaussianBlur(image, (0, 0), 12), np.uint8))
    half = image.copy()
    half[:, : image.shape[1] // 2] = 90
    assert rover.calls(half)
