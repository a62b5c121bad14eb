"""Checkpoints from the hub: a server here plays it, so that nothing leaves this machine."""

from __future__ import annotations

import hashlib
import json
import socket
import threading
import time
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from anytraverse.errors import BundleError
from anytraverse.export import export_bundle
from tests.anytraverse.export.checkpoints import write_clipseg

pytestmark = pytest.mark.needs_export

ID = "somebody/clipseg"
SHA = "0123456789" * 4
Serve = Callable[[str], None]


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = write_clipseg(tmp_path_factory.mktemp("hub") / "files", {})
    (folder / "README.md").write_text("---\nlicense: apache-2.0\n---\n")
    (folder / "tf_model.h5").write_bytes(b"nobody needs this")
    return folder


@pytest.fixture(autouse=True)
def serve(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Serve:
    """Says where the hub is. The client's cache is empty."""
    monkeypatch.setattr("huggingface_hub.constants.HF_HUB_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr("huggingface_hub.constants.HF_HUB_ETAG_TIMEOUT", 0.5)

    def at(endpoint: str) -> None:
        monkeypatch.setattr("huggingface_hub.constants.ENDPOINT", endpoint)
        monkeypatch.setattr(
            "huggingface_hub.constants.HUGGINGFACE_CO_URL_TEMPLATE",
            endpoint + "/{repo_id}/resolve/{revision}/{filename}",
        )

    at("http://127.0.0.1:9")  # the port of nobody
    return at


@pytest.fixture
def hub(checkpoint: Path, serve: Serve) -> Iterator[list[str]]:
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
        serve(f"http://127.0.0.1:{server.server_port}")
        yield downloaded
        server.shutdown()


def etag(path: Path) -> str:
    return hashlib.sha1(path.read_bytes(), usedforsecurity=False).hexdigest()


def test_an_id_is_downloaded_with_what_is_needed_and_its_source_is_told(
    hub: list[str], tmp_path: Path
) -> None:
    manifest = export_bundle(ID, tmp_path / "bundle", size=96)
    assert manifest.source == {"weights": ID, "licence": "apache-2.0", "revision": SHA}
    assert manifest.name == "clipseg"
    assert {"model.safetensors", "config.json", "preprocessor_config.json", "vocab.json"} <= set(hub)
    assert "tf_model.h5" not in hub


def test_what_was_downloaded_before_needs_no_network(hub: list[str], tmp_path: Path, serve: Serve) -> None:
    export_bundle(ID, tmp_path / "first", size=96)
    hub.clear()
    serve("http://127.0.0.1:9")
    assert export_bundle(ID, tmp_path / "second", size=96).source["revision"] == SHA
    assert hub == []


def test_without_network_it_is_said_what_to_copy_from_where(tmp_path: Path) -> None:
    begin = time.monotonic()
    with pytest.raises(BundleError) as refused:
        export_bundle(ID, tmp_path / "bundle")
    assert time.monotonic() - begin < 5
    text = str(refused.value)
    assert "hf download somebody/clipseg --local-dir clipseg" in text
    for name in ("config.json", "preprocessor_config.json", "vocab.json", "merges.txt", "model.safetensors"):
        assert name in text


def test_a_network_that_swallows_everything_is_waited_for_seconds_not_minutes(
    tmp_path: Path, serve: Serve
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as hole:
        serve(f"http://127.0.0.1:{hole.getsockname()[1]}")
        begin = time.monotonic()
        with pytest.raises(BundleError, match="cannot be had from the hub"):
            export_bundle(ID, tmp_path / "bundle")
    assert time.monotonic() - begin < 5


@pytest.mark.parametrize(
    "name", ["./nothing", "/no/such/folder", "nothing", "a/b/c", "~/nothing", "https://x/y"]
)
def test_what_is_no_id_is_not_looked_for_on_the_hub(name: str, tmp_path: Path) -> None:
    with pytest.raises(BundleError, match="is no folder: give one, or an id of the hub like owner/name"):
        export_bundle(name, tmp_path / "bundle")
