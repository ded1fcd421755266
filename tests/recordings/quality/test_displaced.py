"""Spikes that are many, or close to one another."""

import numpy as np
import pytest
from made_up_hopper import MARKERS, hopping

from hopdata.recordings.quality.surprises import surprises

RATES_AND_NOISES = [(100.0, 3e-4), (300.0, 3e-4), (300.0, 1e-3)]


def spikes_of(positions):
    found = {}
    for spike in surprises(positions).spikes:
        for frame in range(spike.start, spike.stop):
            found[spike.marker, frame] = spike.size
    return found


def displaced_by(positions, marker, frames, sizes_m, rng):
    changed = positions.copy()
    ways = rng.normal(size=(len(frames), 3))
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    changed[frames, marker] += np.reshape(sizes_m, (-1, 1)) * ways
    return changed


@pytest.mark.parametrize(("rate_hz", "noise_m"), RATES_AND_NOISES)
@pytest.mark.parametrize("marker", ["hip1", "toe1"])
def test_many_spikes_do_not_hide_one_another(rate_hz, noise_m, marker):
    clean = hopping(31, n_frames=6000, rate_hz=rate_hz, noise_m=noise_m)[1]
    rng = np.random.default_rng(31)
    frames = rng.choice(np.arange(20, 5980, 7), 40, replace=False)
    m = MARKERS.index(marker)

    found = spikes_of(displaced_by(clean, m, frames, np.full(40, 0.045), rng))

    assert set(found) == {(m, frame) for frame in frames.tolist()}
    assert list(found.values()) == pytest.approx(np.full(40, 0.045), rel=0.25)
    assert not spikes_of(clean)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_spikes_close_to_one_another_are_told_at_their_own_frames(seed):
    clean = hopping(seed, n_frames=3000, rate_hz=200.0)[1]
    rng = np.random.default_rng(seed)
    frames = np.array([1000, 1009, 1015, 1018, 2000, 2003, 2012])
    sizes_m = np.array([0.039, 0.034, 0.046, 0.03, 0.042, 0.04, 0.026])

    found = spikes_of(displaced_by(clean, MARKERS.index("hip2"), frames, sizes_m, rng))

    assert [frame for _, frame in sorted(found)] == frames.tolist()
    sizes_found = [found[key] for key in sorted(found)]
    assert sizes_found == pytest.approx(sizes_m, rel=0.25)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_clean_frame_between_two_spikes_is_not_told(seed):
    clean = hopping(seed, n_frames=3000, rate_hz=200.0)[1]
    rng = np.random.default_rng(seed)
    frames = [1000, 1002]

    found = spikes_of(displaced_by(clean, MARKERS.index("hip2"), frames, 0.04, rng))

    assert {frame for _, frame in found} <= {*frames}
