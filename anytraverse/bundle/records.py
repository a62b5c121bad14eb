"""Stores the record of a bundle's check on a machine, and chooses the variant that may run by it.

A record is stored in the bundle's folder as `checks/<machine>.json`. It is valid only for that machine, that
manifest and that version of ONNX Runtime.
"""

from __future__ import annotations

import json
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path

from anytraverse.bundle.fields import Fields, parse_object
from anytraverse.bundle.files import replace_text
from anytraverse.bundle.machine import Machine, this_machine
from anytraverse.bundle.manifest import Manifest, manifest_digest
from anytraverse.bundle.writing import CHECKS
from anytraverse.errors import BundleError
from anytraverse.perception.runtime import Runtime
from anytraverse.regular_file import read_regular

RECORD_FORMAT = 1
_LARGEST = 1 << 20


@dataclass(frozen=True)
class CheckRecord:
    """Holds the result of comparing int8 with fp32.

    manifest: the SHA-256 of the manifest checked. when: UTC, ISO 8601.
    masks: the number compared, those of fp32 that are neither empty nor full. iou: the worst word's, its
    masks pooled; iou_worst, iou_mean: of single masks; None without masks.
    stray: the largest share of a picture that differs where fp32's mask is empty or full.
    cosine: the smallest between the embeddings of a frame.
    fp32_ms, int8_ms: medians of a whole step; gain: their ratio. passed, why: the verdict and its reason.
    """

    machine: Machine
    manifest: str
    when: str
    provider: str
    threads: int
    frames: int
    words: tuple[str, ...]
    masks: int
    iou: float | None
    iou_worst: float | None
    iou_mean: float | None
    stray: float
    cosine: float
    fp32_ms: float
    int8_ms: float
    gain: float
    passed: bool
    why: str


@dataclass(frozen=True)
class CheckRuntime(Runtime):
    """Lets a check run the variant that `precision` names without a record of it."""


def choose_precision(folder: Path, manifest: Manifest, runtime: Runtime) -> tuple[str, str]:
    """Choose the variant to run; return its name and the reason in a sentence.

    int8 runs only where it has passed a check on this machine: its speed depends on the CPU's instructions,
    its masks on the rounding of the weights. Raises BundleError when int8 is demanded and must not run.
    """
    if runtime.precision == "fp32":
        return "fp32", "fp32 was asked for"
    demanded = runtime.precision == "int8"
    if demanded and "int8" in manifest.variants and isinstance(runtime, CheckRuntime):
        return "int8", "int8 is being checked"
    allowed, why = _int8_allowed(folder, manifest, runtime)
    if demanded and not allowed:
        raise BundleError(f"{folder}: int8 must not run here: {why}; or set the precision to fp32")
    if "int8" not in manifest.variants:
        return "fp32", why
    return ("int8", f"int8 {why}") if allowed else ("fp32", f"int8 stays off: {why}")


def _int8_allowed(folder: Path, manifest: Manifest, runtime: Runtime) -> tuple[bool, str]:
    if "int8" not in manifest.variants:
        advice = " (export it with --precision fp32,int8)" if manifest.kind != "classes" else ""
        return False, f"the bundle carries no int8 variant{advice}"
    if runtime.providers[0] != "CPU":
        return False, f"int8 is checked on the CPU alone, and {runtime.providers[0]} comes first"
    record, why = read_record(folder, manifest_digest(folder))
    if record is None:
        return False, f"{why} (run: {check_command(folder)})"
    verdict = "passed" if record.passed else "failed"
    return record.passed, f"{verdict} its check on {record.when[:10]}: {record.why}"


def check_command(folder: Path) -> str:
    """Return the command that makes a record on this machine."""
    return f"anytraverse bundle check {folder} --frames FOLDER"


def record_path(folder: Path, machine: Machine) -> Path:
    """Return the path of the machine's record."""
    return folder / CHECKS / f"{machine.id}.json"


def check_writable(folder: Path) -> None:
    """Raise BundleError, before minutes of comparing, when no record can be written to the bundle."""
    path = folder / CHECKS
    try:
        path.mkdir(exist_ok=True)
        with tempfile.TemporaryFile(dir=path):
            pass
    except OSError as error:
        raise _unwritable(path, error) from error


def _unwritable(path: Path, error: OSError) -> BundleError:
    return BundleError(
        f"the record of the check cannot be written to {path} ({error.strerror}): "
        "check the bundle as a user who may write there, or without --frames, which times it only"
    )


def save_record(folder: Path, record: CheckRecord) -> Path:
    """Write the record atomically and return its path. Raises BundleError when it cannot be written."""
    path = record_path(folder, record.machine)
    text = json.dumps({"format": RECORD_FORMAT, **asdict(record)}, indent=2, allow_nan=False) + "\n"
    try:
        path.parent.mkdir(exist_ok=True)
        replace_text(path, text)
    except OSError as error:
        raise _unwritable(path, error) from error
    return path


def read_record(folder: Path, digest: str, machine: Machine | None = None) -> tuple[CheckRecord | None, str]:
    """Return this machine's record of the manifest `digest`; None, with the reason, without a valid one."""
    machine = machine or this_machine()
    path = record_path(folder, machine)
    try:
        record = _record(parse_object(read_regular(path, _LARGEST), path.name))
    except FileNotFoundError:
        return None, "not checked on this machine"
    except OSError as error:
        return None, f"the record of the check cannot be read ({error.strerror})"
    except BundleError:
        return None, "the record of the check is torn, or of another version of this program"
    if record.manifest != digest:
        return None, "the bundle has changed since it was checked"
    if record.machine.onnxruntime != machine.onnxruntime:
        then, now = record.machine.onnxruntime, machine.onnxruntime
        return None, f"checked with onnxruntime {then}, but {now} is installed"
    if record.machine != machine:
        return None, "checked on another machine"
    return record, record.why


def _record(fields: Fields) -> CheckRecord:
    fields.whole("format", RECORD_FORMAT, RECORD_FORMAT)
    machine = fields.object("machine")
    return CheckRecord(
        machine=Machine(
            cpu=machine.text("cpu"),
            architecture=machine.text("architecture", empty=True),
            flags=machine.texts("flags"),
            cores=machine.whole("cores", 1, 1 << 16),
            onnxruntime=machine.text("onnxruntime"),
        ),
        manifest=fields.text("manifest"),
        when=fields.text("when"),
        provider=fields.text("provider"),
        threads=fields.whole("threads", 1, 1 << 16),
        frames=fields.whole("frames", 0, 1 << 20),
        words=fields.texts("words"),
        masks=fields.whole("masks", 0, 1 << 30),
        iou=_share(fields, "iou"),
        iou_worst=_share(fields, "iou_worst"),
        iou_mean=_share(fields, "iou_mean"),
        stray=fields.number("stray", 0.0, 1.0),
        cosine=fields.number("cosine", -1.01, 1.01),
        fp32_ms=fields.number("fp32_ms", 0.0, 1e9),
        int8_ms=fields.number("int8_ms", 0.0, 1e9),
        gain=fields.number("gain", 0.0, 1e9),
        passed=fields.flag("passed"),
        why=fields.text("why"),
    )


def _share(fields: Fields, name: str) -> float | None:
    return None if fields.any(name) is None else fields.number(name, 0.0, 1.0)
