"""Keeps what a perceiver saw of frames on disk, so that each is perceived once, by however many settings it
is judged."""

from __future__ import annotations

import hashlib
import io
import os
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from anytraverse.frame import Image
from anytraverse.perception import (
    DefaultThresholds,
    Example,
    Features,
    Perceiver,
    Prompt,
    is_independent,
    is_joint,
    surroundings_of,
)
from anytraverse.regions import Box

MOST_BYTES = 4_000_000_000
_DIGEST = 12
_HEX = "[0-9a-f]" * (2 * _DIGEST)
_NAMES = (f"{_HEX}/{_HEX}-*.npy", f"{_HEX}/.{_HEX}*.part")
"""What a store removes: its own files and what is left of unfinished ones, nobody else's."""
_COUNTS = 64
"""How often a store that writes all it may hold looks how much others have written meanwhile."""

Array = NDArray[np.float32]


def default_cache() -> Path:
    """Return the folder for what was seen of frames, as XDG has it."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "anytraverse"


class PerceptionStore:
    """Holds arrays in a folder: one file for each frame and what was asked of it, float32 as they were.

    A file is an .npy with a digest behind it. Several processes may use one folder at a time. It holds about
    `most` bytes. Beyond that it removes what was used least recently, but nothing that was used since this
    store was opened: what does not fit beside that is not stored.
    """

    def __init__(self, folder: Path, identity: str, most: int = MOST_BYTES) -> None:
        """identity: names all that the arrays depend on besides frame and question. Raises OSError."""
        self._root = folder
        self._folder = folder / _digest(identity.encode())
        self._folder.mkdir(parents=True, exist_ok=True)
        self._most = most
        self._opened = time.time()
        self._bytes = sum(size for _, _, size in self._files())
        self._since_counted = 0
        self._full = False

    def get(self, frame: str, asked: str) -> Array | None:
        """Return an array; None where it is not stored, or its file is damaged."""
        path = self._path(frame, asked)
        try:
            content = path.read_bytes()
        except OSError:
            return None
        whole, digest = content[:-_DIGEST], content[-_DIGEST:]
        if hashlib.blake2b(whole, digest_size=_DIGEST).digest() != digest:
            with suppress(OSError):
                path.unlink()
            return None
        with suppress(OSError):
            os.utime(path)
        array: Array = np.load(io.BytesIO(whole), allow_pickle=False)
        return array

    def put(self, frame: str, asked: str, array: Array) -> None:
        """Store an array, whole or not at all. A full disk is no error: the next run perceives it again."""
        file = io.BytesIO()
        np.save(file, array, allow_pickle=False)
        whole = file.getvalue()
        content = whole + hashlib.blake2b(whole, digest_size=_DIGEST).digest()
        if not self._has_room(len(content)):
            return
        partial = ""
        try:
            # a name of its own: threads, and computers that share the folder, may store the same frame
            descriptor, partial = tempfile.mkstemp(".part", f".{frame}-{asked}", self._folder)
            with open(descriptor, "wb") as out:
                out.write(content)
            os.replace(partial, self._path(frame, asked))
        except OSError:
            if partial:
                with suppress(OSError):
                    os.unlink(partial)
            return
        self._bytes += len(content)
        self._since_counted += len(content)

    def _path(self, frame: str, asked: str) -> Path:
        return self._folder / f"{frame}-{asked}.npy"

    def _files(self) -> Iterator[tuple[float, Path, int]]:
        """Yield when each file was last used, where it is, and its bytes."""
        for name in _NAMES:
            for path in self._root.glob(name):
                try:
                    state = path.stat()
                except OSError:  # another process removed it
                    continue
                yield state.st_mtime, path, state.st_size

    def _has_room(self, needed: int) -> bool:
        """Return whether so many bytes may be stored; old files are removed for them."""
        if self._full:
            return False
        if self._since_counted > self._most / _COUNTS or self._bytes + needed > self._most:
            self._make_room(needed)
        # what is left then was used in this run: there will be no room later either
        self._full = self._bytes + needed > self._most
        return not self._full

    def _make_room(self, needed: int) -> None:
        """Count what is stored. Beyond `most` remove old files, and a tenth more than needed."""
        files = sorted(self._files())
        self._bytes, self._since_counted = sum(size for _, _, size in files), 0
        if self._bytes + needed <= self._most:
            return
        wanted = self._most * 0.9 - needed
        for used, path, size in files:
            if self._bytes <= wanted or used >= self._opened:
                return
            with suppress(OSError):
                path.unlink()
                self._bytes -= size


class StoredFeatures:
    """Holds a frame, and what was asked of it. The perceiver encodes it only where something is not stored.

    made: what is computed from the maps, by keys of the caller's own. It goes with the frame.
    """

    def __init__(self, image: Image, perceiver: Perceiver, store: PerceptionStore) -> None:
        self.made = dict[Any, Any]()
        self._image = image
        self._perceiver = perceiver
        self._store = store
        self._frame = _digest(repr(image.shape).encode(), np.ascontiguousarray(image).data)
        self._encoded: Features = None
        self._attended = dict[tuple[Prompt, ...], Array]()
        self._embedding: Array | None = None
        self._surroundings: Array | None = None
        self._examples = dict[Box, Example]()

    @property
    def encoded(self) -> Features:
        """The perceiver's own features. Raises PerceiverError."""
        if self._encoded is None:
            self._encoded = self._perceiver.encode(self._image)
        return self._encoded

    def attend(self, prompts: tuple[Prompt, ...]) -> Array:
        """Return the attention maps. Raises as the perceiver does."""
        if prompts not in self._attended:
            asked = _digest(*map(_told, prompts))
            array = self._store.get(self._frame, asked)
            if array is None:
                array = np.asarray(self._perceiver.attend(self.encoded, prompts), np.float32)
                self._store.put(self._frame, asked, array)
            self._attended[prompts] = array.view()
            self._attended[prompts].flags.writeable = False  # trials share it
        return self._attended[prompts]

    def embed(self) -> Array:
        """Return the scene's embedding. Raises PerceiverError."""
        if self._embedding is None:
            array = self._store.get(self._frame, "scene")
            if array is None:
                array = np.asarray(self._perceiver.embed(self.encoded), np.float32)
                self._store.put(self._frame, "scene", array)
            self._embedding = array
        return self._embedding

    def surroundings(self) -> Array | None:
        """Return the vector of the surroundings, None of a perceiver without one. Raises PerceiverError."""
        if self._surroundings is None:
            array = self._store.get(self._frame, "surroundings")
            if array is None:
                array = surroundings_of(self._perceiver, self.encoded)
                if array is not None:
                    self._store.put(self._frame, "surroundings", array)
            self._surroundings = array
        return self._surroundings

    def example(self, box: Box) -> Example:
        """Return the example of a box: one object, so that words learnt from it are asked for once."""
        if box not in self._examples:
            self._examples[box] = self._perceiver.example(self.encoded, box)
        return self._examples[box]


class StoredPerceiver:
    """Sees what another perceiver sees, and asks it only for what is not stored."""

    def __init__(self, perceiver: Perceiver, store: PerceptionStore) -> None:
        self.perceiver = perceiver
        self._store = store
        self._newest: StoredFeatures | None = None
        self._image: Image | None = None
        self.independent, self.joint = is_independent(perceiver), is_joint(perceiver)

    @property
    def model_id(self) -> str:
        """As the perceiver's own."""
        return self.perceiver.model_id

    @property
    def vocabulary(self) -> tuple[str, ...] | None:
        """As the perceiver's own."""
        return self.perceiver.vocabulary

    @property
    def defaults(self) -> DefaultThresholds:
        """As the perceiver's own."""
        return self.perceiver.defaults

    def meaning(self, word: str) -> str:
        """Return the perceiver's own."""
        return self.perceiver.meaning(word)

    def encode(self, image: Image) -> StoredFeatures:
        """Return features that the perceiver has not made yet. Those of the newest image are made once."""
        if self._newest is None or image is not self._image:
            self._image, self._newest = image, StoredFeatures(image, self.perceiver, self._store)
        return self._newest

    def attend(self, features: StoredFeatures, prompts: Sequence[Prompt]) -> Array:
        """Return attention maps, which several callers share: they cannot be changed."""
        return features.attend(tuple(prompts))

    def embed(self, features: StoredFeatures) -> Array:
        """Return the scene's embedding."""
        return features.embed()

    def surroundings(self, features: StoredFeatures) -> Array | None:
        """Return the vector of the surroundings, None of a perceiver without one."""
        return features.surroundings()

    def example(self, features: StoredFeatures, box: Box) -> Example:
        """Make an example, by the perceiver's own features."""
        return features.example(box)


def _told(prompt: Prompt) -> bytes:
    """Return all that a prompt asks."""
    vectors = b"".join(example.model_id.encode() + example.vector.tobytes() for example in prompt.examples)
    return repr((prompt.word, prompt.drivable, len(prompt.examples))).encode() + vectors


def _digest(*parts: Any) -> str:
    hashed = hashlib.blake2b(digest_size=_DIGEST)
    for part in parts:
        hashed.update(len(part).to_bytes(8, "little"))
        hashed.update(part)
    return hashed.hexdigest()
