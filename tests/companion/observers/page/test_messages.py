"""What supervisor and web process say to each other survives the way, and rubbish is refused."""

from __future__ import annotations

import contextlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.observers.page.messages import PageMessageKind
from companion.system.datagrams import LARGEST, Datagram, decode

JSON = st.dictionaries(
    st.text(max_size=8),
    st.recursive(
        st.none() | st.booleans() | st.integers() | st.floats(-1e9, 1e9) | st.text(),
        lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner, max_size=3),
        max_leaves=8,
    ),
    max_size=4,
)


@given(st.sampled_from(list(PageMessageKind)), JSON, st.binary(max_size=64))
def test_a_message_is_read_as_it_was_written(
    kind: PageMessageKind, content: dict[str, object], picture: bytes
) -> None:
    message = Datagram(kind, content, picture)
    assert decode(message.encoded()) == message


@given(st.sampled_from([b"", b"n{", b"p{}\n", b"c[", b'n{"a":']), st.binary(max_size=64))
def test_any_bytes_are_a_message_or_a_value_error(head: bytes, tail: bytes) -> None:
    with contextlib.suppress(ValueError):
        found = decode(head + tail)
        assert isinstance(found.content, dict)


def test_deeply_nested_bytes_are_refused() -> None:
    with pytest.raises(ValueError, match="nested"):
        decode(b"n" + b"[" * 100_000)


@pytest.mark.parametrize("content", [{"x": "y" * LARGEST}, {"x": float("nan")}, {"x": float("inf")}])
def test_what_is_too_long_or_no_number_is_not_sent(content: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=r"bytes, at most|JSON compliant"):
        Datagram(PageMessageKind.NEWS, content).encoded()
