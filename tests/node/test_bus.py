from __future__ import annotations

from threading import Event

from node.bus.in_process import KEEP_LAST, Bus


def test_a_late_joiner_gets_the_last_value() -> None:
    with Bus() as bus:
        bus.publish("level", 1)
        bus.publish("level", 2)
        subscription = bus.subscribe("level")
        bus.publish("level", 3)
        subscription.close()
        assert list(subscription) == [2, 3]


def test_latest_and_topics() -> None:
    with Bus() as bus:
        assert bus.latest("b") is None
        bus.publish("b", 1)
        bus.publish("a", 2)
        assert bus.latest("b") == 1
        assert bus.topics() == ["a", "b"]


def test_a_callback_that_hangs_stalls_nobody_and_its_losses_are_counted() -> None:
    release, entered, seen = Event(), Event(), []

    def hang(message: int) -> None:
        entered.set()
        release.wait(10)
        seen.append(message)

    with Bus() as bus:
        slow = bus.subscribe("level", hang)
        quick = bus.subscribe("level", depth=100)
        bus.publish("level", 0)
        assert entered.wait(5)
        for message in range(1, 50):
            bus.publish("level", message)
        quick.close()
        assert list(quick) == list(range(50))
        assert slow.dropped == 49 - KEEP_LAST
        release.set()


def test_a_callback_that_raises_is_counted_and_called_again() -> None:
    done, calls = Event(), []

    def fail(message: int) -> None:
        calls.append(message)
        if message == 1:
            done.set()
        raise ValueError("on purpose")

    with Bus() as bus:
        subscription = bus.subscribe("level", fail)
        bus.publish("level", 0)
        bus.publish("level", 1)
        assert done.wait(5)
        assert calls == [0, 1]
        assert subscription.errors >= 1


def test_without_subscribers_nothing_needs_to_be_made() -> None:
    with Bus() as bus:
        assert not bus.has_subscribers("image")
        subscription = bus.subscribe("image")
        assert bus.has_subscribers("image")
        subscription.close()
        assert not bus.has_subscribers("image")
