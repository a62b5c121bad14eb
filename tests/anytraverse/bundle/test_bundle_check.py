"""`anytraverse bundle check`, with a perceiver that needs no network and time that passes by its work."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from anytraverse.bundle.manifest import manifest_digest
from anytraverse.bundle.records import read_record
from anytraverse.bundle.timing import Timing
from anytraverse.cli import main
from anytraverse.perception import make_perceiver
from anytraverse.perception.runtime import Runtime
from tests.anytraverse.bundle.conftest import Clock

MakeBundle = Callable[..., Path]
Out = pytest.CaptureFixture[str]

pytestmark = pytest.mark.usefixtures("sham")


def figures(capsys: Out) -> dict[str, Any]:
    """The JSON on the last line."""
    found: dict[str, Any] = json.loads(capsys.readouterr().out.splitlines()[-1])
    return found


def test_a_good_int8_is_recorded_and_runs_from_then_on(
    make_bundle: MakeBundle, frames: Path, capsys: Out
) -> None:
    folder = make_bundle(gain=4.0)
    assert make_perceiver(f"sham:{folder}", Runtime()).precision == "fp32"  # type: ignore[attr-defined]
    assert main(["bundle", "check", str(folder), "--frames", str(frames), "--json"]) == 0
    found = figures(capsys)
    assert found["variant"] == "int8"
    assert found["record"]["passed"] is True
    assert found["record"]["masks"] == 36
    assert found["record"]["iou"] == 1.0
    assert found["record"]["gain"] == pytest.approx(4.0)
    assert found["milliseconds"]["fp32"]["step"] == pytest.approx(100.0)
    assert found["milliseconds"]["int8"]["step"] == pytest.approx(25.0)
    assert found["frames_per_second"] == pytest.approx(30.0)
    assert found["freshness_s"] == 1.0
    assert read_record(folder, manifest_digest(folder))[0] is not None
    assert make_perceiver(f"sham:{folder}", Runtime()).precision == "int8"  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("flaws", "why"),
    [
        ({"shift": 1}, "IoU of"),
        ({"turn": 0.2}, "cosine of embeddings is 0.98"),
        ({"nan": True}, "not finite"),
        ({"fails": True}, "the network failed"),
        ({"loads": False}, "cannot load"),
        ({"gain": 1.0}, "1.00 times as fast"),
    ],
)
def test_a_bad_int8_is_recorded_and_does_not_run(
    make_bundle: MakeBundle, frames: Path, capsys: Out, flaws: dict[str, Any], why: str
) -> None:
    folder = make_bundle(**{"gain": 4.0, **flaws})
    assert main(["bundle", "check", str(folder), "--frames", str(frames)]) == 1
    said = capsys.readouterr().out.splitlines()[-1]
    assert "fp32: int8 stays off: failed its check" in said
    assert why in said
    found, _ = read_record(folder, manifest_digest(folder))
    assert found is not None
    assert not found.passed
    assert make_perceiver(f"sham:{folder}", Runtime()).precision == "fp32"  # type: ignore[attr-defined]


def test_without_frames_int8_stays_off_and_that_is_said(make_bundle: MakeBundle, capsys: Out) -> None:
    folder = make_bundle()
    assert main(["bundle", "check", str(folder), "--repeat", "1"]) == 0
    captured = capsys.readouterr()
    assert "not checked on this machine" in captured.out
    assert "--frames FOLDER" in captured.out
    assert "image.onnx" in captured.err
    assert not (folder / "checks").exists()


def test_a_person_reads_what_was_timed_and_what_rate_it_allows(make_bundle: MakeBundle, capsys: Out) -> None:
    assert main(["bundle", "check", str(make_bundle()), "--precision", "int8", "--threads", "1"]) == 0
    said = capsys.readouterr().out
    assert "a sham: sham, 64x64, scene shared" in said
    assert "threads 1" in said
    assert "3 verified" in said
    assert "int8 alone" in said
    assert "up to 10 frames/s, and a freshness limit T of 1.0 s" in said


def test_int8_may_be_the_first_to_be_loaded(make_bundle: MakeBundle, frames: Path, capsys: Out) -> None:
    folder = make_bundle(gain=4.0)
    command = ["bundle", "check", str(folder), "--frames", str(frames), "--precision", "int8", "--json"]
    assert main(command) == 0
    found = figures(capsys)
    assert list(found["milliseconds"]) == ["int8", "fp32"]
    assert found["record"]["gain"] == pytest.approx(4.0)


def test_a_slow_model_is_told_to_be_too_slow_to_hold(make_bundle: MakeBundle, capsys: Out) -> None:
    folder = make_bundle(gain=0.1)
    assert main(["bundle", "check", str(folder), "--precision", "int8"]) == 0
    assert (
        "too slow for the hold policy: what is known of the trail may be 3.0 s old" in capsys.readouterr().out
    )


def test_words_are_looked_for_as_given(make_bundle: MakeBundle, frames: Path, capsys: Out) -> None:
    folder = make_bundle(gain=4.0)
    command = [
        "bundle",
        "check",
        str(folder),
        "--frames",
        str(frames),
        "--json",
        "--words",
        "green, red,green",
    ]
    assert main(command) == 0
    assert figures(capsys)["record"]["words"] == ["green", "red"]


def test_a_torn_bundle_is_refused_in_one_line(make_bundle: MakeBundle, capsys: Out) -> None:
    folder = make_bundle()
    (folder / "image.onnx").write_bytes(b"weightz" * 100)
    assert main(["bundle", "check", str(folder)]) == 2
    said = capsys.readouterr().err.splitlines()[-1]
    assert said.startswith("anytraverse bundle check: ")
    assert "image.onnx is torn" in said


def test_a_bundle_of_a_kind_that_is_not_known_is_refused(
    make_bundle: MakeBundle, capsys: Out, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delitem(make_perceiver.__globals__["KINDS"], "sham")
    assert main(["bundle", "check", str(make_bundle())]) == 2
    assert '"sham"' in capsys.readouterr().err


def test_frames_that_are_not_there_are_told(make_bundle: MakeBundle, tmp_path: Path, capsys: Out) -> None:
    assert main(["bundle", "check", str(make_bundle()), "--frames", str(tmp_path / "absent")]) == 2
    assert "does not exist" in capsys.readouterr().err


@pytest.mark.parametrize(
    "arguments", [["--repeat", "0"], ["--words", ","], ["--words", "a:b"], ["--precision", "int4"]]
)
def test_arguments_that_mean_nothing_are_refused(make_bundle: MakeBundle, arguments: list[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["bundle", "check", str(make_bundle()), *arguments])
    assert ended.value.code == 2


def test_a_rate_that_is_promised_leaves_an_ok_fresh() -> None:
    def timing(slowest: float) -> Timing:
        return Timing(1, 1, 1, 1, None, 1, slowest / 2, slowest, slowest)

    assert (timing(20).rate, timing(20).freshness) == (30.0, 1.0)
    assert (timing(500).rate, timing(500).freshness) == (2.0, 1.5)
    assert (timing(1500).pace.worst_age, timing(1500).freshness) == (4.5, 2.0)
    assert timing(20).pace.keeps
    assert timing(660).pace.keeps
    assert not timing(670).pace.keeps


def test_frames_that_are_not_there_are_told_before_anything_is_timed(
    make_bundle: MakeBundle, tmp_path: Path, capsys: Out
) -> None:
    assert main(["bundle", "check", str(make_bundle()), "--frames", str(tmp_path / "no")]) == 2
    told = capsys.readouterr().err
    assert "does not exist" in told
    assert "timing" not in told


def test_a_record_that_cannot_be_kept_is_told_before_anything_is_compared(
    make_bundle: MakeBundle, frames: Path, capsys: Out
) -> None:
    folder = make_bundle()
    (folder / "checks").write_text("in the way")
    assert main(["bundle", "check", str(folder), "--frames", str(frames)]) == 2
    told = capsys.readouterr().err
    assert "cannot be written" in told
    assert "without --frames" in told
    assert "timing" not in told


def test_a_file_is_not_a_bundle(tmp_path: Path, capsys: Out) -> None:
    (tmp_path / "file").write_text("")
    assert main(["bundle", "check", str(tmp_path / "file")]) == 2
    assert "is not a bundle" in capsys.readouterr().err


@pytest.mark.slow
def test_other_programs_do_not_make_a_model_slow_but_are_told(
    make_bundle: MakeBundle, capsys: Out, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = make_bundle()
    monkeypatch.setattr(Clock, "perf_counter", lambda clock: clock.now * 10)  # nine more programs
    assert main(["bundle", "check", str(folder), "--json"]) == 0
    found = figures(capsys)
    assert found["milliseconds"]["fp32"]["step"] == pytest.approx(100.0)
    assert found["milliseconds"]["fp32"]["clock"] == pytest.approx(1000.0)
    assert found["frames_per_second"] == pytest.approx(10.0)
    assert found["machine_busy"] is True
    assert main(["bundle", "check", str(folder)]) == 0
    said = capsys.readouterr().out
    assert "up to 10 frames/s" in said
    assert "judged by CPU time: a frame took 1000 ms by the clock" in said


def test_where_threads_share_the_work_the_clock_counts(
    make_bundle: MakeBundle, capsys: Out, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Clock, "process_time", lambda clock: clock.now * 4)  # four threads
    assert main(["bundle", "check", str(make_bundle()), "--json"]) == 0
    found = figures(capsys)
    assert found["milliseconds"]["fp32"]["step"] == pytest.approx(100.0)
    assert found["machine_busy"] is False
