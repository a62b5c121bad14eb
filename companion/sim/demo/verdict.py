"""Judges by its figures whether the demo has shown all that it must, and says it."""

from __future__ import annotations

from typing import Any

from companion.sim.demo.story import Story

BYTES_PER_S = 300.0


def verdict(figures: dict[str, Any], story: Story, *, guide: bool = False) -> int:
    """Prints what was not shown, or that all was; returns the exit code."""
    left = (missing_guided if guide else missing)(figures)
    for name in left:
        story.plain(f"NOT SHOWN: {name}")
    if not left:
        story.plain("All of the job was shown.")
    return 1 if left else 0


def summary(figures: dict[str, Any]) -> str:
    """Returns one line with the totals of a demo that a person answered."""
    return (
        f"{figures['calls']} calls, {figures['holds']} holds, {figures['resumes']} resumes, "
        f"{figures['history_matches']} places known again, {figures['collisions']} things driven into."
    )


def about_the_computer(figures: dict[str, Any]) -> str:
    """Returns one line about how fast this computer was. It is no part of the verdict."""
    aim, latency = figures["fps_aimed_at"], figures["latency_ms_p50"]
    aimed = "" if aim is None else f" of {aim:g} aimed at"
    late = (
        "" if latency is None else f", and the ground heard of each {latency / 1000:.1f} s after it was taken"
    )
    slowed = figures["slowed_down"]
    busier = (
        f" It became too busy, and drove slower, {slowed} time{'s' if slowed > 1 else ''}." if slowed else ""
    )
    return (
        f"This computer judged {figures['fps']:.1f} pictures a second{aimed}{late}; "
        f"the rover drove at {figures['speed']:g} m/s.{busier}"
    )


def missing(figures: dict[str, Any]) -> list[str]:
    """What the demo should have shown and did not; empty when all is proven."""
    wanted = {
        "at least two calls": figures["calls"] >= 2,
        "a call for an unknown object alone": figures["calls_unknown_object"] >= 1,
        "a call for an unknown scene": figures["calls_unknown_scene"] >= 1,
        "answers acknowledged": figures["answers"] >= 2,
        "an answer by a tapped box": figures["answers_by_tap"] >= 1,
        "an answer by words": figures["answers_by_words"] >= 1,
        "at least two holds": figures["holds"] >= 2,
        "as many resumes by the companion as holds that no human ended": 0
        < figures["resumes"]
        == figures["holds"] - figures["taken_over"],
        "a blocked state that kept off the named thing": figures["kept_off_named_things"] >= 1,
        "a return to a known place that nobody was asked about": figures["returned_without_call"],
        "a match in the history": figures["history_matches"] >= 1,
        "no contact with anything": figures["collisions"] == 0,
        "policy hold that can be given": not figures["hold_refused"],
        f"at most {BYTES_PER_S:g} bytes per second": figures["bytes_per_s"] <= BYTES_PER_S,
        "summaries at the ground": figures["summaries_received"] >= 1,
    }
    return [name for name, shown in wanted.items() if not shown]


def missing_guided(figures: dict[str, Any]) -> list[str]:
    """What the demo of guiding should have shown and did not; empty when all is proven."""
    wanted = {
        "something that is driven round": figures["driven_round"] >= 1,
        "a call about what leaves no room": figures["things"] >= 1,
        "a blocked state that kept off it": figures["kept_off_named_things"] >= 1,
        "no contact with anything": figures["collisions"] == 0,
        "policy guide that can be given": not figures["hold_refused"],
    }
    return [name for name, shown in wanted.items() if not shown]
