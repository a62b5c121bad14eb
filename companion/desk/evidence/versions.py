"""Tells which program, packages and model run on this rover."""

from __future__ import annotations

import subprocess
from pathlib import Path

from anytraverse.bundle.manifest import manifest_digest
from anytraverse.errors import AnyTraverseError
from anytraverse.release import program_identity
from companion.desk.evidence.parts import Basis, EvidencePart
from companion.desk.evidence.sources import Sources
from companion.observers.recording.incident import versions
from companion.wire.json_values import mapping_of, text_of
from companion.wire.packing import clean

_ROOT = Path(__file__).resolve().parents[3]
_PATIENCE = 5.0


def versions_part(sources: Sources) -> EvidencePart:
    """Describe what is installed."""
    part, driven, commit = EvidencePart("Versions"), sources.driven, _commit()
    part.tell(
        Basis("this computer", None, sources.now, sources.now),
        *((f"version of {name}", number, "") for name, number in versions().items() if name != "computer"),
        ("commit", commit or None, ""),
        ("digest of the judging code and its libraries", program_identity(), ""),
        ("digest of the bundle's manifest", _bundle_digest(sources.config.perceiver.name), ""),
    )
    if model := clean(text_of(mapping_of(sources.status.get("perceiver")).get("model"))):
        part.tell(Basis("status.json", None, sources.written, sources.written), ("model", model, ""))
    elif driven.model:
        part.tell(driven.basis(driven.files), ("model", driven.model, ""))
    else:
        part.lack("the model that judged", "no companion has run with this folder", "companion run")
    if not commit:
        how = "install from a checkout, or compare the digest above"
        part.lack("the commit", "an installed package does not name it", how)
    return part


def _commit() -> str:
    """Return the id of the checkout's commit, with "-dirty" for changed files; "" outside of one."""
    if not (_ROOT / ".git").exists():
        return ""
    # Root, too, reads a checkout of somebody else, whose code it runs already.
    asked = ["git", "-c", f"safe.directory={_ROOT}", "describe", "--always", "--dirty", "--exclude=*"]
    try:
        ran = subprocess.run(
            asked, cwd=_ROOT, check=True, capture_output=True, text=True, timeout=_PATIENCE, errors="replace"
        )
    except (OSError, subprocess.SubprocessError):
        return ""
    return ran.stdout.strip()[:64]


def _bundle_digest(perceiver: str) -> str | None:
    folder = perceiver.partition(":")[2]
    try:
        return manifest_digest(Path(folder)) if folder else None
    except (AnyTraverseError, OSError):
        return None
