"""Root goes about in a folder with its owner's rights."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from companion.system.as_owner import as_owner

NOBODY = 65534


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can take another user's rights")
@pytest.mark.parametrize("inside", [".", "not/yet/made"])
def test_root_has_the_rights_of_who_owns_the_folder_or_the_nearest_above_it(
    tmp_path: Path, inside: str
) -> None:
    os.chown(tmp_path, NOBODY, NOBODY)
    groups = os.getgroups()
    with as_owner(tmp_path / inside):
        assert (os.geteuid(), os.getegid(), os.getgroups()) == (NOBODY, NOBODY, [])
    assert (os.geteuid(), os.getegid(), os.getgroups()) == (0, 0, groups)


def test_nothing_changes_for_who_is_not_root_or_in_roots_own_folder(tmp_path: Path) -> None:
    before = os.geteuid(), os.getegid(), os.getgroups()
    with as_owner(tmp_path):
        assert (os.geteuid(), os.getegid(), os.getgroups()) == before
