"""Tells which program, packages and model run on this rover."""

from __future__ import annotations

import subprocess
from pathlib import Path

from anytraverse.bundle.manifest import manifest_digest
from anytraverse.errors import AnyTraverseError
from anytraverse.release import program_identity
from companion.desk.evidence.parts import Basis, EvidencePart, NotKnown, figures
from companion.desk.evidence.sources import Sources
from companion.observers.recording.incident import versions
from companion.wire.json_values import text_of
from companion.wire.packing import clean

_ROOT = Path(__file__).resolve().parents[3]
_PATIENCE = 5.0


def versions_part(sources: Sources) -> EvidencePart:
    """Describe what is installed."""
    commit, digest, unknown = _commit(), _bundle_digest(sources.config.perceiver.name), list[NotKnown]()
    model, driven = clean(text_of(sources.told("perceiver").get("model"))), sources.driven
    told = Basis("status.json", None, sources.written, sources.written)
    if not model:
        model, told = driven.model, Basis("recordings", driven.files, driven.begin, driven.end)
    found = figures(
        Basis("this computer", None, sources.now, sources.now),
        (
            *(
                (f"version of {name}", number, "")
                for name, number in versions().items()
                if name != "computer"
            ),
            ("commit", commit or None, ""),
            ("digest of the judging code and its libraries", program_identity(), ""),
            ("digest of the bundle's manifest", digest or None, ""),
        ),
    )
    if model:
        found += figures(told, [("model", model, "")])
    else:
        unknown.append(
            NotKnown("the model that judged", "no companion has run with this folder", "companion run")
        )
    if not commit:
        why = "an installed package does not name it"
        unknown.append(NotKnown("the commit", why, "install from a checkout, or compare the digest above"))
    return EvidencePart("versions", "Versions", found, (), tuple(unknown))


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


def _bundle_digest(perceiver: str) -> str:
    folder = perceiver.partition(":")[2]
    try:
        return manifest_digest(Path(folder)) if folder else ""
    except (AnyTraverseError, OSError):
        return ""
