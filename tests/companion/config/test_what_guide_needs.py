"""Policy guide is refused until all that it needs is configured, and the text names what is missing."""

from __future__ import annotations

from dataclasses import replace

import pytest

from companion.config import Config
from companion.config.guiding import guide_lacks, outline
from companion.config.schema import GuideSection, MountSection, StoppingSection
from companion.wire import notices

WHOLE = replace(
    Config(),
    mount=MountSection(height=0.6, tilt=15.0, width=0.7),
    stopping=StoppingSection(speed=1.2, hold_by="brake"),
    guide=GuideSection(radius=1.5),
)
LACKS = {
    "[mount] height": replace(WHOLE, mount=MountSection(width=0.7)),
    "[mount] width": replace(WHOLE, mount=MountSection(height=0.6, tilt=15.0)),
    "[stopping] speed": replace(WHOLE, stopping=StoppingSection(hold_by="brake")),
    '[stopping] hold_by = "brake"': replace(WHOLE, stopping=StoppingSection(speed=1.2)),
    "[guide] radius": replace(WHOLE, guide=GuideSection()),
}


def test_nothing_is_missing_of_what_is_all_there() -> None:
    assert guide_lacks(WHOLE) == ""
    planned = outline(WHOLE)
    assert planned is not None
    assert (planned.width, planned.radius) == (0.7, 1.5)


@pytest.mark.parametrize(("setting", "config"), LACKS.items(), ids=LACKS)
def test_what_is_missing_is_named_in_a_text_that_is_not_cut(setting: str, config: Config) -> None:
    assert guide_lacks(config) == setting
    assert notices.guide_lacks(setting) == f"GUIDE refused: set {setting}"


@pytest.mark.parametrize("setting", ["[mount] width", "[guide] radius"])
def test_nothing_is_planned_for_a_vehicle_of_unknown_outline(setting: str) -> None:
    assert outline(LACKS[setting]) is None
