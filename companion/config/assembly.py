"""From the configuration to what the algorithm and the state machine take."""

from __future__ import annotations

from anytraverse.judging import Settings
from anytraverse.judging import Thresholds as JudgingThresholds
from anytraverse.perception import DefaultThresholds
from anytraverse.regions import Box
from anytraverse.roi import Corridor
from companion.calls.numbers import Numbers
from companion.config.schema import Config
from companion.wire.ids import Policy


def judging_settings(config: Config, own: DefaultThresholds) -> Settings:
    """How frames are judged. own: the perceiver's thresholds, which count where none is set."""
    roi, limits, call = config.roi, config.thresholds, config.call
    tile = own.tile if limits.tile is None else limits.tile
    return Settings(
        region=Box(roi.left, roi.top, roi.right, roi.bottom),
        thresholds=JudgingThresholds(
            roi=own.roi if limits.roi is None else limits.roi,
            scene=own.scene if limits.scene is None else limits.scene,
            tile=None if isinstance(tile, str) else tile,
            trav=limits.trav,
            margin=call.margin,
            similarity_margin=call.similarity_margin,
        ),
        corridor=Corridor(config.corridor.bottom, config.corridor.top),
        tile_share=roi.tile_share,
        freshness=config.freshness,
        votes=call.votes,
        window=call.window,
    )


def call_numbers(config: Config, own: DefaultThresholds) -> Numbers:
    """When the operator is called. own: the perceiver's thresholds."""
    call = config.call
    return Numbers(
        policy=Policy[call.policy.upper()],
        judging=judging_settings(config, own),
        votes=call.votes,
        window=call.window,
        ok_frames=call.ok_frames,
        passed_after=call.passed_after,
        accepted_for=call.accepted_for,
        accepted_distance=call.accepted_distance,
        accepted_rise=call.accepted_rise,
        go_lasts=call.go_lasts,
        fault_ends_hold=call.fault_ends_hold,
    )
