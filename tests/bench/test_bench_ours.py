"""This project's step, as the benchmark runs it, does what the authors' does."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bench.clipseg.frames import make_frame
from bench.clipseg.lineup import BUNDLES, CONTESTANTS

pytestmark = pytest.mark.needs_export


@pytest.mark.parametrize(("name", "part"), [("int8", "tail"), ("fp32_clip_b32", "scene")])
def test_it_finds_what_the_authors_step_finds(tmp_path: Path, name: str, part: str) -> None:
    from bench.clipseg import bundles, ours, reference
    from bench.clipseg.checkpoints import TINY, make_checkpoints

    made, entry = make_checkpoints(tmp_path, TINY), CONTESTANTS[name]
    theirs = reference.make(str(made.clipseg), str(made.clip), threads=1)
    bundle = bundles.make(tmp_path, entry.bundle, tiny=True)
    contestant = ours.Ours(str(bundle), entry.precision, threads=1)
    for each in (contestant, theirs):
        each.set_prompts(["grass", "tree"], [1.0, -1.0])
    frame = make_frame(128, 96, 1)
    found, expected = contestant.figures(frame), theirs.figures(frame)
    assert found.roi_uncertainty == pytest.approx(expected.roi_uncertainty, abs=0.05)
    assert found.roi_traversability == pytest.approx(expected.roi_traversability, abs=0.05)
    assert np.linalg.norm(found.embedding) == pytest.approx(1.0, abs=1e-5)
    assert set(contestant.parts.take()) == {"resize", "tower", part, "decoder", "pooling"}
    if entry.same_encoder:
        assert np.dot(found.embedding, expected.embedding) > 0.999


def test_a_smaller_size_has_its_own_bundle(tmp_path: Path) -> None:
    from anytraverse.bundle.manifest import read_manifest
    from bench.clipseg import bundles
    from bench.clipseg.checkpoints import TINY, make_checkpoints

    make_checkpoints(tmp_path, TINY)
    name = CONTESTANTS["fp32_224"].bundle
    assert read_manifest(bundles.make(tmp_path, name, tiny=True)).image.width == BUNDLES[name].tiny
