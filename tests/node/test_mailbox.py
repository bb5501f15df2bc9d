from __future__ import annotations

from threading import Thread

import pytest
from hypothesis import given
from hypothesis import strategies as st

from node.mailbox import Closed, Mailbox


@given(st.lists(st.integers(), max_size=30), st.integers(1, 8))
def test_newest_win_and_the_rest_is_counted(items: list[int], depth: int) -> None:
    mailbox: Mailbox[int] = Mailbox(depth, lossless=False)
    for item in items:
        mailbox.put(item)
    mailbox.close()
    got = _drain(mailbox)
    assert got == items[-depth:]
    assert mailbox.dropped == len(items) - len(got)


def test_lossless_waits_for_room_and_keeps_everything() -> None:
    mailbox: Mailbox[int] = Mailbox(2, lossless=True)

    def fill() -> None:
        for item in range(100):
            mailbox.put(item)
        mailbox.close()

    writer = Thread(target=fill)
    writer.start()
    assert _drain(mailbox) == list(range(100))
    writer.join()
    assert mailbox.dropped == 0


def test_closing_frees_a_waiting_writer() -> None:
    mailbox: Mailbox[int] = Mailbox(1, lossless=True)
    mailbox.put(1)
    writer = Thread(target=mailbox.put, args=(2,))
    writer.start()
    mailbox.close()
    writer.join(5)
    assert not writer.is_alive()


def test_get_times_out_when_nothing_comes() -> None:
    with pytest.raises(TimeoutError):
        Mailbox[int](1, lossless=False).get(timeout_s=0.01)


def _drain(mailbox: Mailbox[int]) -> list[int]:
    got = []
    while True:
        try:
            got.append(mailbox.get(timeout_s=5))
        except Closed:
            return got
