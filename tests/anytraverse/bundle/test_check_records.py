"""A record of a check holds for one machine, one bundle and one ONNX Runtime, and decides what runs."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from anytraverse.bundle.machine import Machine, this_machine
from anytraverse.bundle.manifest import MANIFEST, manifest_digest, read_manifest
from anytraverse.bundle.records import (
    CheckRecord,
    CheckRuntime,
    choose_precision,
    read_record,
    record_path,
    save_record,
)
from anytraverse.errors import BundleError
from anytraverse.perception.runtime import Runtime

MakeBundle = Callable[..., Path]

HERE = this_machine()


def record(folder: Path, **changed: Any) -> CheckRecord:
    """A passed check of the bundle on this machine."""
    passed = CheckRecord(
        machine=HERE,
        manifest=manifest_digest(folder),
        when="2025-06-01T12:00:00+00:00",
        provider="CPU",
        threads=2,
        frames=20,
        words=("grass", "rock"),
        masks=31,
        iou=0.98,
        iou_worst=0.95,
        iou_mean=0.985,
        stray=0.001,
        cosine=0.998,
        fp32_ms=700.0,
        int8_ms=250.0,
        gain=2.8,
        passed=True,
        why="worst IoU 0.980",
    )
    return replace(passed, **changed)


@pytest.fixture
def folder(make_bundle: MakeBundle) -> Path:
    """A bundle with an int8 variant."""
    return make_bundle()


def chosen(folder: Path, runtime: Runtime) -> tuple[str, str]:
    """What runs, and why."""
    return choose_precision(folder, read_manifest(folder), runtime)


def test_a_record_is_read_as_it_was_saved(folder: Path) -> None:
    saved = record(folder, iou=None, iou_worst=None, iou_mean=None, passed=False)
    path = save_record(folder, saved)
    assert path == record_path(folder, HERE) == folder / "checks" / f"{HERE.id}.json"
    assert read_record(folder, manifest_digest(folder)) == (saved, saved.why)
    assert [file.name for file in path.parent.iterdir()] == [path.name]


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({"manifest": "0" * 64}, "the bundle has changed"),
        ({"machine": replace(HERE, onnxruntime="0.9")}, "checked with onnxruntime 0.9, but"),
    ],
)
def test_a_record_of_other_circumstances_does_not_hold(
    folder: Path, changed: dict[str, Any], why: str
) -> None:
    save_record(folder, record(folder, **changed))
    found, told = read_record(folder, manifest_digest(folder))
    assert found is None
    assert why in told


def test_another_machines_record_does_not_hold_even_under_our_name(folder: Path) -> None:
    other = Machine("another CPU", "x86_64", ("avx2",), 4, HERE.onnxruntime)
    path = save_record(folder, record(folder, machine=other))
    assert read_record(folder, manifest_digest(folder)) == (None, "not checked on this machine")
    path.rename(record_path(folder, HERE))
    assert read_record(folder, manifest_digest(folder)) == (None, "checked on another machine")


def test_a_bundle_made_anew_must_be_checked_anew(folder: Path) -> None:
    save_record(folder, record(folder))
    text = (folder / MANIFEST).read_text()
    (folder / MANIFEST).write_text(text.replace('"a sham"', '"another"'))
    assert chosen(folder, Runtime())[0] == "fp32"


@given(st.integers(0, 2000), st.binary(max_size=2))
def test_a_damaged_record_never_fails_to_be_read(
    tmp_path_factory: pytest.TempPathFactory, place: int, damage: bytes
) -> None:
    folder = tmp_path_factory.getbasetemp() / "damaged"
    folder.mkdir(exist_ok=True)
    (folder / MANIFEST).write_text("{}")
    path = save_record(folder, record(folder))
    text = path.read_bytes()
    place %= len(text)
    path.write_bytes(text[:place] + damage + text[place + 1 :])
    found, why = read_record(folder, manifest_digest(folder))
    assert found is None or isinstance(found, CheckRecord)
    assert why or found is not None


@pytest.mark.parametrize("content", ["", "{}", "[]", '{"format": 2}'])
def test_a_torn_record_does_not_hold(folder: Path, content: str) -> None:
    save_record(folder, record(folder)).write_text(content)
    found, why = read_record(folder, manifest_digest(folder))
    assert found is None
    assert "torn" in why


def test_a_record_without_a_verdict_is_torn(folder: Path) -> None:
    path = save_record(folder, record(folder))
    values = json.loads(path.read_text())
    del values["passed"]
    path.write_text(json.dumps(values))
    assert read_record(folder, manifest_digest(folder))[0] is None


def test_a_folder_that_cannot_be_written_is_told(folder: Path) -> None:
    (folder / "checks").write_text("a file")
    with pytest.raises(BundleError, match="cannot be written"):
        save_record(folder, record(folder))


def test_fp32_runs_where_it_is_asked_for(folder: Path) -> None:
    save_record(folder, record(folder))
    assert chosen(folder, Runtime(precision="fp32")) == ("fp32", "fp32 was asked for")


def test_int8_runs_by_itself_only_where_its_check_passed(folder: Path) -> None:
    variant, why = chosen(folder, Runtime())
    assert variant == "fp32"
    assert f"not checked on this machine (run: anytraverse bundle check {folder} --frames FOLDER)" in why
    save_record(folder, record(folder, passed=False, why="it is 0.76 times as fast"))
    assert chosen(folder, Runtime()) == (
        "fp32",
        "int8 stays off: failed its check on 2025-06-01: it is 0.76 times as fast",
    )
    save_record(folder, record(folder))
    assert chosen(folder, Runtime()) == ("int8", "int8 passed its check on 2025-06-01: worst IoU 0.980")


def test_int8_that_is_demanded_runs_only_where_its_check_passed(folder: Path) -> None:
    demanded = Runtime(precision="int8")
    with pytest.raises(BundleError, match="run: anytraverse bundle check"):
        chosen(folder, demanded)
    save_record(folder, record(folder, passed=False, why="it is slow"))
    with pytest.raises(BundleError, match="it is slow"):
        chosen(folder, demanded)
    save_record(folder, record(folder))
    assert chosen(folder, demanded)[0] == "int8"


def test_a_check_may_run_int8_before_there_is_a_record(folder: Path) -> None:
    assert chosen(folder, CheckRuntime(precision="int8"))[0] == "int8"
    assert chosen(folder, CheckRuntime(precision="fp32"))[0] == "fp32"
    assert chosen(folder, CheckRuntime(precision="auto"))[0] == "fp32"


def test_int8_stays_off_where_something_else_than_the_cpu_comes_first(folder: Path) -> None:
    save_record(folder, record(folder))
    variant, why = chosen(folder, Runtime(providers=("CUDA", "CPU")))
    assert variant == "fp32"
    assert "CUDA comes first" in why
    with pytest.raises(BundleError, match="CUDA comes first"):
        chosen(folder, Runtime(providers=("CUDA",), precision="int8"))
    assert chosen(folder, Runtime(providers=("CPU", "CUDA")))[0] == "int8"


def test_a_bundle_without_int8_runs_fp32_and_says_how_to_get_one(folder: Path) -> None:
    manifest = read_manifest(folder)
    lean = replace(manifest, variants={"fp32": manifest.variants["fp32"]})
    variant, why = choose_precision(folder, lean, Runtime())
    assert variant == "fp32"
    assert "--precision fp32,int8" in why
    for runtime in (Runtime(precision="int8"), CheckRuntime(precision="int8")):
        with pytest.raises(BundleError, match="carries no int8 variant"):
            choose_precision(folder, lean, runtime)
