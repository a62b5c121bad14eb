"""Runs networks with ONNX Runtime: with which providers, on how many cores, in which precision."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

from anytraverse.errors import PerceiverError
from anytraverse.release import to_install

if TYPE_CHECKING:
    import onnxruntime

PROVIDERS = {
    "CPU": "CPUExecutionProvider",
    "CUDA": "CUDAExecutionProvider",
    "TensorRT": "TensorrtExecutionProvider",
    "OpenVINO": "OpenVINOExecutionProvider",
    "ROCm": "ROCMExecutionProvider",
    "MIGraphX": "MIGraphXExecutionProvider",
    "CoreML": "CoreMLExecutionProvider",
    "XNNPACK": "XnnpackExecutionProvider",
    "ACL": "ACLExecutionProvider",
    "QNN": "QNNExecutionProvider",
}
"""Our names -> ONNX Runtime's."""

PRECISIONS = ("auto", "fp32", "int8")


def _nothing() -> None:
    pass


@dataclass(frozen=True)
class Runtime:
    """Holds how networks are run.

    providers: names of `PROVIDERS`, the preferred one first; the CPU runs what they cannot run.
    threads: cores that one network may use; 0: all that this process may use.
    precision: the bundle's variant; "auto": int8 where a check on this machine has passed it, else fp32.
    progress: called between the parts of what takes longer than a frame, such as the text of a new word.
    Raises PerceiverError for an unknown name or a number out of range.
    """

    providers: tuple[str, ...] = ("CPU",)
    threads: int = 0
    precision: str = "auto"
    progress: Callable[[], None] = field(default=_nothing, compare=False, repr=False)

    def __post_init__(self) -> None:
        for name in self.providers:
            if name not in PROVIDERS:
                raise PerceiverError(f'no provider is called "{name}": choose from {", ".join(PROVIDERS)}')
        if not 0 <= self.threads <= 256:
            raise PerceiverError(f"threads is {self.threads}: give 0 (all cores) to 256")
        if self.precision not in PRECISIONS:
            raise PerceiverError(f'no precision is called "{self.precision}": choose {", ".join(PRECISIONS)}')

    @property
    def cores(self) -> int:
        """The number of threads that one network gets."""
        return self.threads or len(os.sched_getaffinity(0))


def available_providers() -> tuple[str, ...]:
    """Return the names of `PROVIDERS` that the installed ONNX Runtime has. Raises PerceiverError."""
    installed = load_onnxruntime().get_available_providers()
    return tuple(name for name, theirs in PROVIDERS.items() if theirs in installed)


def open_session(model: Path, runtime: Runtime, *, once: bool = False) -> onnxruntime.InferenceSession:
    """Open a session for a network file.

    Sessions take turns in one thread. So each may use all cores, but its workers must not keep spinning
    after its turn. once: the session will be closed after a few runs. Its weights then stay mapped from disk,
    not rearranged in memory, which takes longer than a run. Raises PerceiverError when a provider is missing
    or the network cannot be read.
    """
    ort = load_onnxruntime()
    available = available_providers()
    missing = [name for name in runtime.providers if name not in available]
    if missing:
        raise PerceiverError(
            f"ONNX Runtime has no provider {', '.join(missing)} here, "
            f"only {', '.join(available)}: "
            "change `providers`, or install the build that has it in place of onnxruntime "
            "(onnxruntime-gpu: CUDA, TensorRT; onnxruntime-openvino: OpenVINO)"
        )
    options = ort.SessionOptions()
    options.intra_op_num_threads = runtime.cores
    options.inter_op_num_threads = 1
    options.execution_mode = ort.ExecutionMode.ORT_SEQUENTIAL
    options.log_severity_level = 3
    options.enable_mem_pattern = False  # its plan allocates memory for the largest run and never frees it
    _share_memory()
    options.add_session_config_entry("session.use_env_allocators", "1")
    options.add_session_config_entry("session.force_spinning_stop", "1")
    if once:
        options.add_session_config_entry("session.disable_prepacking", "1")
    names = [PROVIDERS[name] for name in dict.fromkeys((*runtime.providers, "CPU"))]
    try:
        session = ort.InferenceSession(str(model), options, names)
    except Exception as error:  # ONNX Runtime raises a dozen classes of its own
        why = " ".join(str(error).split())
        raise PerceiverError(f"ONNX Runtime cannot load {model.name}: {why}") from error
    if not once:
        give_back_memory()
    return session


def run_session(
    session: onnxruntime.InferenceSession,
    given: Mapping[str, NDArray[Any]],
    outputs: Sequence[str] | None = None,
) -> list[NDArray[Any]]:
    """Run a network and return its outputs in order, all or those named. Raises PerceiverError."""
    try:
        return list(session.run(outputs, dict(given)))
    except Exception as error:  # ONNX Runtime raises a dozen classes of its own
        raise PerceiverError(f"the network failed: {' '.join(str(error).split())[:200]}") from error


def give_back_memory() -> None:
    """Return freed memory to the system: glibc would keep what opening and closing a network freed."""
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).malloc_trim(0)


@cache
def _share_memory() -> None:
    """Let all sessions share one memory arena, since they take turns.

    arena_extend_strategy 1 (kSameAsRequested) extends it by what is requested, and not in powers of two.
    """
    ort = load_onnxruntime()
    place = ort.OrtMemoryInfo("Cpu", ort.OrtAllocatorType.ORT_ARENA_ALLOCATOR, 0, ort.OrtMemType.DEFAULT)
    ort.create_and_register_allocator(place, ort.OrtArenaCfg({"arena_extend_strategy": 1}))


def load_onnxruntime() -> onnxruntime:
    """Import ONNX Runtime with its telemetry off. Raises PerceiverError when it is not installed.

    Since 1.29 it reports to its maker and writes files to the home folder, unless this variable is set
    before the import.
    """
    os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")
    try:
        import onnxruntime
    except ImportError:
        raise PerceiverError(f"networks need ONNX Runtime: {to_install('rover')}") from None
    return onnxruntime
