from hypothesis import given
from hypothesis import strategies as st

from companion.link.answer_store import SenderCache

senders = st.tuples(st.integers(250, 253), st.just(1))


@given(st.lists(st.tuples(senders, st.integers(0, 9), st.booleans()), max_size=80))
def test_each_sender_s_newest_are_known_as_far_as_there_is_room(
    steps: list[tuple[tuple[int, int], int, bool]],
) -> None:
    kept, known = SenderCache[int](of_a_sender=3, in_all=10), dict[tuple[tuple[int, int], int], int]()
    for at, (sender, wish, goes) in enumerate(steps):
        key = (sender, wish)
        known.pop(key, None)
        if goes:
            kept.pop(key)
        else:
            kept.put(key, at)
            known[key] = at
        own = [one for one in known if one[0] == sender]
        for old in own[:-3] or (list(known)[:-10] if len(known) > 10 else []):
            del known[old]
        assert {one: kept.get(one) for one in known} == known
        assert len(kept) == len(known)
