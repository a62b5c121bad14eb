"""`bundle check --frames` calibrates a dense bundle, and refuses frames on which it cannot."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from anytraverse.bundle.calibrating import CHANCE, calibrate, scores_of_absent
from anytraverse.bundle.manifest import manifest_digest, read_manifest, verify
from anytraverse.bundle.pictures import frames_of
from anytraverse.bundle.records import read_record
from anytraverse.cli import main
from anytraverse.errors import BundleError
from anytraverse.frame import Image
from anytraverse.perception import Prompt, make_perceiver
from anytraverse.perception.dense.details import GROUP
from anytraverse.perception.dense.perceiver import Dense
from anytraverse.preferences import MAX_WORDS
from tests.anytraverse.clipseg.pictures import picture
from tests.anytraverse.dense.conftest import CHECKING, ONE

Out = pytest.CaptureFixture[str]


def frames(count: int) -> Iterator[Image]:
    return (picture(96, 72, seed) for seed in range(count))


@pytest.mark.slow
def test_groups_of_absent_words_reach_one_half_by_chance_alone(bundle: Path) -> None:
    eyes = Dense(str(bundle), CHECKING)
    found = calibrate(bundle, eyes, frames(24), ["grass"], print)
    eyes = Dense(str(bundle), ONE)
    assert eyes.calibration == found.calibration
    assert found.calibration.frames == 24
    reached, medians = [], []
    for frame in frames(24):
        places = eyes.encode(frame).directions.reshape(32, -1)
        scores = scores_of_absent(eyes.absent, places)
        rising = (scores - found.calibration.threshold) / found.calibration.temperature
        attention = 1 / (1 + np.exp(-rising))
        reached.append(attention.reshape(-1, GROUP, 64).max(axis=1) >= 0.5)
        medians.append(attention)
    assert float(np.mean(reached)) == pytest.approx(CHANCE, abs=0.005)
    assert float(np.median(medians)) == pytest.approx(0.02, abs=0.002)


@pytest.mark.slow
def test_as_many_words_as_may_be_asked_for_explain_no_more_than_chance_if_all_are_absent(
    bundle: Path,
) -> None:
    found = calibrate(bundle, Dense(str(bundle), CHECKING), frames(24), ["grass"], print)
    eyes = Dense(str(bundle), ONE)
    explained = []
    for start in range(0, len(eyes.absent), MAX_WORDS):
        words = eyes.details.absent[start : start + MAX_WORDS]
        eyes._words._known |= dict(zip(words, eyes.absent[start:], strict=False))
        for frame in frames(24):
            attention = eyes.attend(eyes.encode(frame), [Prompt(word) for word in words])
            explained.append(attention.max(axis=0) >= 0.5)
    assert float(np.mean(explained)) < 1.2 * found.calibration.chance


def test_a_score_of_an_absent_word_leaves_the_word_itself_out() -> None:
    random = np.random.default_rng(0)
    absent, places = random.normal(size=(9, 5)), random.normal(size=(5, 4))
    made = scores_of_absent(absent.astype(np.float32), places.astype(np.float32))
    for index in range(9):
        others = np.delete(absent, index, axis=0).mean(axis=0)
        np.testing.assert_allclose(made[index], (absent[index] - others) @ places, atol=1e-5)


def test_a_word_that_fits_explains_its_places_and_one_that_does_not_explains_none(bundle: Path) -> None:
    eyes = Dense(str(bundle), CHECKING)
    seen = eyes.encode(picture(96, 72, 0))
    thing = seen.directions[:, 4, 4]
    eyes._words._cache["thing"] = thing  # as if its text were just where this patch is
    eyes._words._cache["nothing"] = -thing
    calibrate(bundle, eyes, frames(24), ["thing"], print)
    eyes.calibration = Dense(str(bundle), ONE).calibration
    thing_map, nothing_map = eyes.attend(seen, [Prompt("thing"), Prompt("nothing")])
    assert thing_map[4, 4] > 0.99
    assert nothing_map[4, 4] < 0.01


@pytest.mark.slow
def test_calibrating_changes_the_manifest_alone_and_the_same_frames_make_the_same_one(
    bundle: Path, terrain: Path, capsys: Out
) -> None:
    before = {path: path.read_bytes() for path in bundle.iterdir() if path.is_file()}
    mode = (bundle / "manifest.json").stat().st_mode
    digests = []
    for _ in range(2):
        assert main(["bundle", "check", str(bundle), "--frames", str(terrain), "--repeat", "1"]) in (0, 1)
        digests.append(manifest_digest(bundle))
    assert digests[0] == digests[1]
    changed = [path.name for path, content in before.items() if path.read_bytes() != content]
    assert changed == ["manifest.json"]
    assert (bundle / "manifest.json").stat().st_mode == mode
    assert not list(bundle.glob("*.part"))
    verify(bundle, read_manifest(bundle, "dense"))
    assert "calibrated  on 24 frames, written into the manifest" in capsys.readouterr().out


def test_a_check_calibrates_compares_int8_and_lets_the_bundle_run(
    bundle: Path, terrain: Path, capsys: Out
) -> None:
    command = ["bundle", "check", str(bundle), "--frames", str(terrain), "--threads", "1", "--json"]
    code = main([*command, "--repeat", "1", "--words", "grass,mud"])
    found = json.loads(capsys.readouterr().out.splitlines()[-1])
    calibrated = found["calibrated"]
    assert calibrated["calibration"]["frames"] == 24
    assert calibrated["words"] == ["grass", "mud"]
    assert 0.0 <= calibrated["explained"] <= 1.0
    record, _ = read_record(bundle, manifest_digest(bundle))  # of the manifest with the calibration
    assert record is not None
    assert code == (0 if record.passed else 1)
    assert record.cosine > 0.99
    assert found["milliseconds"]["fp32"]["new_word"] > 0
    eyes = make_perceiver(f"dense:{bundle}", ONE)
    assert eyes.attend(eyes.encode(picture(96, 72, 1)), [Prompt("grass")]).shape == (1, 8, 8)


def test_a_check_without_frames_times_a_bundle_and_says_that_it_does_not_run_yet(
    bundle: Path, calibrated: Path, capsys: Out
) -> None:
    command = ["bundle", "check", "--threads", "1", "--repeat", "1"]
    assert main([*command, str(bundle)]) == 2
    said = capsys.readouterr().out
    assert f"refused     {bundle} is not calibrated" in said
    assert f"run anytraverse bundle check {bundle} --frames FOLDER" in said
    assert "runs here" not in said
    assert "all for a frame" in said
    assert main([*command, str(bundle), "--json"]) == 2
    assert "is not calibrated" in json.loads(capsys.readouterr().out.splitlines()[-1])["refused"]
    assert main([*command, str(calibrated)]) == 0
    assert "runs here   fp32" in capsys.readouterr().out


@pytest.mark.slow
def test_words_that_explain_no_more_than_chance_are_warned_of(
    bundle: Path, terrain: Path, capsys: Out
) -> None:
    main(["bundle", "check", str(bundle), "--frames", str(terrain), "--repeat", "1", "--words", "piano"])
    said = capsys.readouterr().out
    assert "WARNING: these words explain hardly more than words for things that are not there" in said


@pytest.mark.parametrize(
    ("pictures", "reason"),
    [
        (list(frames(19)), "only 19 frames to calibrate on (0 blank and 0 repeated"),
        ([*frames(5), *[np.full((72, 96, 3), 90, dtype=np.uint8)] * 20], "20 blank and 0 repeated"),
        ([picture(96, 72, 0)] * 40, "only 1 frames to calibrate on (0 blank and 39 repeated"),
        ([*frames(2)] * 20, "only 2 frames to calibrate on (0 blank and 38 repeated"),
        ([], "only 0 frames"),
    ],
)
def test_frames_that_do_not_suit_are_refused_with_advice(
    bundle: Path, pictures: list[Image], reason: str
) -> None:
    before = (bundle / "manifest.json").read_bytes()
    with pytest.raises(BundleError) as refused:
        calibrate(bundle, Dense(str(bundle), CHECKING), pictures, ["grass"], print)
    assert reason in str(refused.value)
    assert "take pictures along a drive" in str(refused.value)
    assert (bundle / "manifest.json").read_bytes() == before


def test_too_few_frames_are_one_line_and_code_2(bundle: Path, tmp_path: Path, capsys: Out) -> None:
    few = tmp_path / "few"
    few.mkdir()
    cv2.imwrite(str(few / "one.png"), picture(96, 72, 0))
    assert main(["bundle", "check", str(bundle), "--frames", str(few), "--repeat", "1"]) == 2
    assert "only 1 frames to calibrate on" in capsys.readouterr().err.splitlines()[-1]


def test_a_model_that_tells_no_words_apart_is_refused(bundle: Path) -> None:
    eyes = Dense(str(bundle), CHECKING)
    eyes.absent = np.repeat(eyes.absent[:1], len(eyes.absent), axis=0)
    with pytest.raises(BundleError, match="all words nearly the same score"):
        calibrate(bundle, eyes, frames(24), ["grass"], print)


def test_a_manifest_that_cannot_be_written_is_told(bundle: Path) -> None:
    eyes = Dense(str(bundle), CHECKING)
    (bundle / "manifest.part").mkdir()  # in the way
    with pytest.raises(BundleError, match=r"cannot be written to .* as a user who may write there"):
        calibrate(bundle, eyes, frames(24), ["grass"], print)
    shutil.rmtree(bundle / "manifest.part")


def test_calibrating_reads_folders_as_every_check_does(bundle: Path, terrain: Path) -> None:
    eyes = Dense(str(bundle), CHECKING)
    found = calibrate(bundle, eyes, frames_of(terrain, print), ["grass"], print)
    assert found.calibration.frames == 24


def test_calibrated_bundles_are_compared_and_stay_as_they_are(
    calibrated: Path, terrain: Path, capsys: Out
) -> None:
    before = manifest_digest(calibrated), sorted(calibrated.rglob("*"))
    command = ["bundle", "check", str(calibrated), "--against", str(calibrated), "--frames", str(terrain)]
    assert main([*command, "--words", "grass,piano", "--threads", "1", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (manifest_digest(calibrated), sorted(calibrated.rglob("*"))) == before
    assert found["frames"] == 24
    assert [word["roi_difference"] for word in found["words"].values()] == [0.0, 0.0]
    assert {word["iou"] for word in found["words"].values()} <= {None, 1.0}
