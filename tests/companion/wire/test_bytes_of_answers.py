"""The bytes of answers and acknowledgements, TUNNEL 45003 and 45004: rovers and ground stations have them."""

import math

import pytest

from anytraverse.operations import ForgetCall, ForgetWord, NewEpisode, OtherPlace, SetWord, Tap
from companion.wire.answers import (
    Acknowledgement,
    Answer,
    AnyOperation,
    CancelIncident,
    PackIncident,
    RecordingWish,
    Wish,
)
from companion.wire.delivery import split
from companion.wire.ids import Motion, Outcome, Reasons, Result, Stage
from companion.wire.packing import Fractions, PayloadError

ANSWERS: dict[str, tuple[tuple[AnyOperation, ...], str]] = {
    "a motion alone": ((), "0104030201020101000100"),
    "a word": ((SetWord("dry grass", -0.3),), "01040302010201010001010148f409647279206772617373"),
    "letters beyond ASCII": (
        (SetWord("Gebüsch", 1.0),),
        "010403020102010100010101102708476562c3bc736368",
    ),
    "a tap": (
        (Tap(70001, (0.1, 0.25, 0.5, 0.7531), "drum", -1.0),),
        "01040302010201010001010271110100e803c40988136b1df0d8046472756d",
    ),
    "a word to forget": ((ForgetWord("bush"),), "010403020102010100010103" + "0462757368"),
    "a call to forget": ((ForgetCall(513),), "010403020102010100010104" + "0102"),
    "a new episode": ((NewEpisode(),), "010403020102010100010105"),
    "another place than any": ((OtherPlace(),), "010403020102010100010106" + "0000"),
    "another place than a call's": ((OtherPlace(7),), "010403020102010100010106" + "0700"),
    "an incident file": ((PackIncident(9),), "010403020102010100010107" + "0900"),
    "no incident file any more": ((CancelIncident(9),), "010403020102010100010108" + "0900"),
    "a recording to delete": (
        (RecordingWish(70_000, Wish.DELETE),),
        "010403020102010100010109" + "7011010002",
    ),
    "several operations": (
        (
            ForgetWord("bush"),
            SetWord("rock", 0.0),
            Tap(3, (0.0, 0.0, 1.0, 1.0), "drum", 0.5),
            NewEpisode(),
        ),
        "010403020102010100010403046275736801000004726f636b020300000000000000102710278813046472756d05",
    ),
}
LONG = tuple(SetWord("w" * 40 + str(number), number / 10) for number in range(4))
W = "77" * 40


@pytest.mark.parametrize("name", ANSWERS)
def test_an_answer_has_the_bytes_that_it_always_had(name: str) -> None:
    operations, payload = ANSWERS[name]
    answer = Answer(258, Motion.GO, operations, 0x01020304)
    assert answer.pack().hex() == payload
    assert Answer.unpack(bytes.fromhex(payload)) == (answer, 0, 1)


@pytest.mark.parametrize(
    "box", [(0.4, 0.5, 0.4, 0.6), (0.40001, 0.5, 0.40004, 0.6), (1.1, 0, 1.2, 1), (math.nan,) * 4], ids=str
)
def test_a_tap_whose_box_is_nothing_as_it_is_sent_is_refused(box: Fractions) -> None:
    with pytest.raises(PayloadError, match="box"):
        Answer(3, Motion.STAY, (Tap(3, box, "drum", 0.5),), 77).pack()


def test_a_long_answer_is_split_into_the_parts_that_it_always_had() -> None:
    assert [part.hex() for part in split(Answer(3, Motion.STAY, LONG, 77))] == [
        f"014d00000003000200020201000029{W}3001e80329{W}31",
        f"014d00000003000201020201d00729{W}3201b80b29{W}33",
    ]


def test_an_answer_without_target_and_motion_has_the_bytes_that_it_always_had() -> None:
    assert [part.hex() for part in split(Answer(0, Motion.NONE, transaction=1))] == ["0101000000000000000100"]


@pytest.mark.parametrize(
    ("acknowledgement", "payload"),
    [
        (
            Acknowledgement(
                0x01020304,
                258,
                Result.NOT_COVERED,
                Stage.OPEN,
                Outcome.NONE,
                0.25,
                None,
                Reasons.UNKNOWN_OBJECT,
                0xDEADBEEF,
                "still open",
            ),
            "01040302010201020100c409ffff02efbeadde0a7374696c6c206f70656e",
        ),
        (
            Acknowledgement.without_figures(5, 6, Result.REFUSED, "é" * 60),
            "01050000000600040400ffffffff000000000059" + "c3a9" * 43 + "2e2e2e",
        ),
    ],
)
def test_an_acknowledgement_has_the_bytes_that_it_always_had(
    acknowledgement: Acknowledgement, payload: str
) -> None:
    assert acknowledgement.pack().hex() == payload
