from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binomtest

from drivers.can_frames import CanFrames
from node.gateway_frames import TimedFrames
from node.link_faults import FULL_LOAD_SPACING_NS, LINK_FAULTS, LONGEST_DELAY_NS, LinkFaults

CLUSTERS = 40
SPACING_NS = 250_000
CYCLE_NS = 72_000_000
PER_FRAME = ("drop", "delay", "duplicate", "reorder", "corrupt")
PER_SCAN = ("freeze", "stuck", "silence", "babble")


def scan(number: int) -> TimedFrames:
    """A status frame with its counter, then clusters whose payload tells them apart."""
    count = CLUSTERS + 1
    data = np.zeros((count, 8), np.uint8)
    data[0] = [CLUSTERS, 0, *divmod(2 * number, 256), 0x10, 0, 0, 0]
    data[1:, 0] = np.arange(CLUSTERS)
    data[1:, 1:3] = divmod(number, 256)
    due_ns = number * CYCLE_NS + SPACING_NS * np.arange(count)
    frames = CanFrames(
        stamp_ns=due_ns,
        can_id=np.array([0x600, *[0x701] * CLUSTERS], np.uint32),
        length=np.array([5, *[8] * CLUSTERS], np.uint8),
        data=data,
        flags=np.zeros(count, np.uint8),
        channel=np.zeros(count, np.uint8),
    )
    return TimedFrames(frames, due_ns)


def after(fault: str, rate: float, scans: int, seed: int = 1) -> tuple[LinkFaults, list[bytes]]:
    """Return the faults after some scans, and what came out of each, with its times."""
    faults = LinkFaults("radar", seed)
    out = []
    for k in range(scans):
        parts = faults.apply(scan(k), {fault: rate}, k), faults.babble(scan(k), {fault: rate}, k)
        out.append(b"".join(p.frames.data.tobytes() + p.due_ns.tobytes() for p in parts))
    return faults, out


def counter(timed: TimedFrames) -> bytes:
    return timed.frames.data[0, 2:4].tobytes()


def test_every_fault_is_told_apart() -> None:
    assert set(LINK_FAULTS) == {*PER_FRAME, *PER_SCAN}


@pytest.mark.parametrize("fault", LINK_FAULTS)
def test_the_rate_holds_and_zero_is_the_identity(fault: str) -> None:
    scans = 200 if fault in PER_FRAME else 2000
    faults, _ = after(fault, 30, scans)
    trials = scans * (CLUSTERS + 1) if fault in PER_FRAME else scans
    interval = binomtest(faults.counts[fault], trials).proportion_ci(0.999)
    assert interval.low <= 0.3 <= interval.high
    none, out = after(fault, 0, 3)
    assert not none.counts.total()
    assert out == [s.frames.data.tobytes() + s.due_ns.tobytes() for s in map(scan, range(3))]


@pytest.mark.parametrize("fault", LINK_FAULTS)
def test_the_seed_repeats_a_fault(fault: str) -> None:
    _, first = after(fault, 40, 20)
    _, again = after(fault, 40, 20)
    _, other = after(fault, 40, 20, seed=2)
    assert first == again != other


def test_what_a_rate_hits_is_hit_by_a_higher_one_too() -> None:
    few = LinkFaults("radar", 1).apply(scan(3), {"drop": 20}, 3)
    many = LinkFaults("radar", 1).apply(scan(3), {"drop": 60}, 3)
    assert set(map(bytes, many.frames.data)) < set(map(bytes, few.frames.data))


def test_dropped_frames_are_missing_and_the_rest_is_untouched() -> None:
    faults = LinkFaults("radar", 1)
    out = faults.apply(scan(0), {"drop": 50}, 0)
    assert len(out) == CLUSTERS + 1 - faults.counts["drop"]
    kept = np.isin(scan(0).due_ns, out.due_ns)
    assert (out.frames.data == scan(0).frames.data[kept]).all()


def test_a_duplicate_follows_its_original() -> None:
    faults = LinkFaults("radar", 1)
    data = faults.apply(scan(0), {"duplicate": 50}, 0).frames.data
    same = (data[1:] == data[:-1]).all(axis=1)
    assert same.sum() == faults.counts["duplicate"] == len(data) - CLUSTERS - 1 > 0


def test_a_corrupt_frame_differs_in_one_bit_of_its_payload() -> None:
    out = LinkFaults("radar", 1).apply(scan(0), {"corrupt": 100}, 0)
    before = scan(0).frames
    bits = np.unpackbits(out.frames.data ^ before.data, axis=1)
    assert (bits.sum(axis=1) == 1).all()
    assert not bits[0, 8 * 5 :].any(), "the status frame has five bytes"
    np.testing.assert_array_equal(before.data, scan(0).frames.data)


def test_reordered_frames_are_all_there_and_leave_at_the_same_times() -> None:
    out = LinkFaults("radar", 1).apply(scan(0), {"reorder": 30}, 0)
    assert sorted(map(bytes, out.frames.data)) == sorted(map(bytes, scan(0).frames.data))
    assert (out.frames.data != scan(0).frames.data).any()
    np.testing.assert_array_equal(out.due_ns, scan(0).due_ns)


def test_a_delayed_frame_holds_up_those_behind_it() -> None:
    out = LinkFaults("radar", 1).apply(scan(0), {"delay": 10}, 0)
    late_ns = out.due_ns - scan(0).due_ns
    assert (np.diff(out.due_ns) >= 0).all()
    assert (late_ns >= 0).all()
    assert 0 < late_ns.max() <= LONGEST_DELAY_NS
    np.testing.assert_array_equal(out.frames.data, scan(0).frames.data)


def test_a_frozen_link_repeats_the_last_scan_to_the_bit_at_the_new_time() -> None:
    faults = LinkFaults("radar", 1)
    faults.apply(scan(0), {}, 0)
    for number in (1, 2):
        out = faults.apply(scan(number), {"freeze": 100}, number)
        np.testing.assert_array_equal(out.frames.data, scan(0).frames.data)
        np.testing.assert_array_equal(out.due_ns, scan(number).due_ns)
    thawed = faults.apply(scan(3), {}, 3)
    np.testing.assert_array_equal(thawed.frames.data, scan(3).frames.data)


def test_a_stuck_counter_stays_while_the_clusters_change() -> None:
    faults = LinkFaults("radar", 1)
    faults.apply(scan(0), {}, 0)
    for number in (1, 2):
        out = faults.apply(scan(number), {"stuck": 100}, number)
        assert counter(out) == counter(scan(0))
        np.testing.assert_array_equal(out.frames.data[1:], scan(number).frames.data[1:])
    assert counter(faults.apply(scan(3), {}, 3)) == counter(scan(3))


def test_a_silent_wire_carries_no_scan_and_no_babble() -> None:
    faults = LinkFaults("radar", 1)
    rates = {"silence": 100, "babble": 100}
    assert not len(faults.apply(scan(0), rates, 0))
    assert faults.silent
    assert not len(faults.babble(scan(0), rates, 0))
    faults.clear()
    assert not faults.silent


def test_a_babbling_node_fills_a_cycle_with_the_highest_priority() -> None:
    out = LinkFaults("radar", 1).babble(scan(2), {"babble": 100}, 2)
    assert (out.frames.can_id == 0).all()
    assert (np.diff(out.due_ns) == FULL_LOAD_SPACING_NS).all()
    assert out.due_ns[0] == scan(2).due_ns[0]
    lasted_ns = out.due_ns[-1] - out.due_ns[0]
    assert CYCLE_NS - 2_000_000 < lasted_ns < CYCLE_NS + 2_000_000
