from types import SimpleNamespace

import numpy as np
import pytest
from live_loop import off_by
from loopback_server import Faults, FaultSource, Outage

from hopdata.errors import ConfigError
from hopdata.steering.live.packets import HEADER
from hopdata.steering.live.simulated import TrueHop
from hopdata.steering.robot import HopperStance


def fates(faults, n, seed=5, n_markers=4):
    source = FaultSource(faults, n_markers, seed)
    drawn = [source.next_fate() for _ in range(n)]
    return np.array([f.dropped for f in drawn]), np.array([f.hidden for f in drawn])


def test_the_same_seed_gives_the_same_faults():
    faults = Faults(dropped=0.1, burst_frames=3, hidden=0.05, garbled=0.1)
    first, again, other = (
        fates(faults, 500),
        fates(faults, 500),
        fates(faults, 500, seed=6),
    )
    assert all(np.array_equal(a, b) for a, b in zip(first, again, strict=True))
    assert not np.array_equal(first[0], other[0])


@pytest.mark.parametrize("burst", [1.0, 4.0])
def test_shares_and_bursts_are_those_asked_for(burst):
    n, share = 40_000, 0.05
    dropped, hidden = fates(Faults(dropped=share, burst_frames=burst, hidden=0.02), n)
    # Frames of a burst are dropped together, so the variance of the share grows by
    # about twice its length.
    assert abs(dropped.mean() - share) < 4 * np.sqrt(2 * burst * share / n)
    assert abs(hidden.mean() - 0.02) < 4 * np.sqrt(0.02 / (4 * n))
    bursts = np.sum(np.diff(dropped.astype(int)) == 1)
    by_chance = 1 / (1 - share) if burst == 1 else burst
    assert dropped.sum() / bursts == pytest.approx(by_chance, rel=0.1)


def test_no_faults_by_default():
    dropped, hidden = fates(Faults(), 200)
    assert not dropped.any()
    assert not hidden.any()


def test_garbled_packets_keep_their_header_and_length():
    source = FaultSource(Faults(garbled=0.5, garbled_bytes=3), 4, seed=1)
    packet = bytes(range(100))
    damaged = source.garbled(packet)
    assert damaged[: HEADER.size] == packet[: HEADER.size]
    assert sum(a != b for a, b in zip(damaged, packet, strict=True)) == 3


def test_wrong_rates_and_kinds_are_refused():
    with pytest.raises(ValueError, match="dropped"):
        Faults(dropped=1.0)
    with pytest.raises(ValueError, match="burst_frames"):
        Faults(burst_frames=0.5)
    with pytest.raises(ConfigError, match="did you mean 'vanish'"):
        Outage(1.0, kind="vanishes")


def test_a_swing_under_faults_is_judged_by_its_own_stance():
    """When its pose was seen does not matter; a wrong pose, boom angle or stance is found."""
    stances = [
        HopperStance(k, np.array([0.1 * k, 0, 6 + k]), 3.0 + k, False, False)
        for k in (1, 2)
    ]
    stances.append(HopperStance(np.nan, np.full(3, np.nan), 5.0, True, False))
    hops = [TrueHop(k - 0.3, 0.5, stance) for k, stance in enumerate(stances, start=1)]

    def off(told_s, **wrong):
        right = {"pose": (0.1, 0.0, 7.0 - 2 * np.pi), "boom_angle_rad": 4.0 - 2 * np.pi}
        return off_by(SimpleNamespace(pose_age_s=0.2, **right | wrong), told_s, hops)

    assert off(1.01) == pytest.approx((0.0, 0.0))
    assert off(1.01, pose=(0.1, 0.3, 7.0)) == pytest.approx((0.3, 0.0))
    assert off(1.01, pose=(0.1, 0.0, 7.3)) == pytest.approx((0.0, 0.3))
    assert off(1.01, boom_angle_rad=3.7) == pytest.approx((0.0, 0.3))
    assert off(2.01) == pytest.approx((0.1, 1.0))
    assert off(1.2) == off(2.9) == (np.inf, np.inf)
