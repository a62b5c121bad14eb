"""Checkpoints from the hub: a server here plays it, so that nothing leaves this machine."""

from __future__ import annotations

import hashlib
import json
import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from anytraverse.bundle.manifest import read_manifest
from anytraverse.errors import BundleError
from anytraverse.export.hub import find_checkpoint
from tests.anytraverse.export.checkpoints import write_clipseg

pytestmark = pytest.mark.needs_export

ID = "somebody/clipseg"
SHA = "0123456789" * 4
NOBODY = "http://127.0.0.1:9"
FIND = """
import sys
from anytraverse.export.hub import find_checkpoint
print(*find_checkpoint(sys.argv[1], words=True))
"""


@dataclass
class Workstation:
    """A computer with an empty cache, where the hub is at `endpoint`: its client reads that only once."""

    cache: Path
    endpoint: str = NOBODY

    def run(self, *command: str) -> subprocess.CompletedProcess[str]:
        given = {
            "HF_ENDPOINT": self.endpoint,
            "HF_HOME": str(self.cache),
            "HF_HUB_ETAG_TIMEOUT": "1",
            "NO_PROXY": "*",
        }
        return subprocess.run(
            [sys.executable, *command],
            env={**os.environ, **given},
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )


@pytest.fixture
def workstation(tmp_path: Path) -> Workstation:
    return Workstation(tmp_path / "cache")


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = write_clipseg(tmp_path_factory.mktemp("hub") / "files", {})
    (folder / "README.md").write_text("---\nlicense: apache-2.0\n---\n")
    (folder / "tf_model.h5").write_bytes(b"nobody needs this")
    return folder


@pytest.fixture
def hub(checkpoint: Path, workstation: Workstation) -> Iterator[list[str]]:
    """A hub that holds the checkpoint; the files that are downloaded from it."""
    downloaded: list[str] = []

    class Hub(BaseHTTPRequestHandler):
        def do_HEAD(self) -> None:
            self.answer(b"" if self.path.startswith("/api/") else self.file().read_bytes(), head=True)

        def do_GET(self) -> None:
            if not self.path.startswith("/api/"):
                downloaded.append(self.file().name)
                self.answer(self.file().read_bytes())
            elif "/tree/" in self.path:
                files = [
                    {"type": "file", "path": path.name, "size": path.stat().st_size, "oid": etag(path)}
                    for path in checkpoint.iterdir()
                ]
                self.answer(json.dumps(files).encode())
            else:
                siblings = [{"rfilename": path.name} for path in checkpoint.iterdir()]
                self.answer(json.dumps({"id": ID, "sha": SHA, "siblings": siblings}).encode())

        def file(self) -> Path:
            return checkpoint / self.path.rpartition("/")[2]

        def answer(self, body: bytes, *, head: bool = False) -> None:
            self.send_response(200)
            self.send_header("Content-Length", str(len(body)))
            self.send_header("X-Repo-Commit", SHA)
            if not self.path.startswith("/api/"):
                self.send_header("ETag", f'"{etag(self.file())}"')
            self.end_headers()
            if not head:
                self.wfile.write(body)

        def log_message(self, *_: object) -> None:
            """Silent."""

    with ThreadingHTTPServer(("127.0.0.1", 0), Hub) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        workstation.endpoint = f"http://127.0.0.1:{server.server_port}"
        yield downloaded
        server.shutdown()


def etag(path: Path) -> str:
    return hashlib.sha1(path.read_bytes(), usedforsecurity=False).hexdigest()


def test_an_id_is_downloaded_with_what_is_needed_and_its_source_is_told(
    hub: list[str], workstation: Workstation, tmp_path: Path
) -> None:
    done = workstation.run("-m", "anytraverse.cli", "export", ID, str(tmp_path / "bundle"), "--size", "96")
    assert done.returncode == 0, done.stderr
    manifest = read_manifest(tmp_path / "bundle")
    assert manifest.source == {"weights": ID, "licence": "apache-2.0", "revision": SHA}
    assert manifest.name == "clipseg"
    assert {"model.safetensors", "config.json", "preprocessor_config.json", "vocab.json"} <= set(hub)
    assert "tf_model.h5" not in hub


def test_what_was_downloaded_before_needs_no_network(hub: list[str], workstation: Workstation) -> None:
    first = workstation.run("-c", FIND, ID)
    assert first.stdout.split()[1:] == [SHA], first.stderr
    hub.clear()
    workstation.endpoint = NOBODY
    assert workstation.run("-c", FIND, ID).stdout == first.stdout
    assert hub == []


def test_without_network_it_is_said_what_to_copy_from_where(workstation: Workstation) -> None:
    text = workstation.run("-c", FIND, ID).stderr
    assert f"BundleError: {ID} is no folder here, and cannot be had from the hub" in text
    assert f"hf download {ID} --local-dir clipseg" in text
    for name in ("config.json", "preprocessor_config.json", "vocab.json", "merges.txt", "model.safetensors"):
        assert name in text


def test_a_network_that_swallows_everything_is_waited_for_seconds_not_minutes(
    workstation: Workstation,
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as hole:
        workstation.endpoint = f"http://127.0.0.1:{hole.getsockname()[1]}"
        begin = time.monotonic()
        assert "cannot be had from the hub" in workstation.run("-c", FIND, ID).stderr
    assert time.monotonic() - begin < 20


@pytest.mark.parametrize(
    "name", ["./nothing", "/no/such/folder", "nothing", "a/b/c", "~/nothing", "https://x/y"]
)
def test_what_is_no_id_is_not_looked_for_on_the_hub(name: str) -> None:
    with pytest.raises(BundleError, match="is no folder: give one, or an id of the hub like owner/name"):
        find_checkpoint(name, words=True)
