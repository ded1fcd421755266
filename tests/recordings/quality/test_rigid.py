import numpy as np
import pytest
from made_up_hopper import MARKERS, hopping

from hopdata.recordings.quality.rigid import frame_noise, pair_distances, rigid_clusters


def clusters(positions):
    return rigid_clusters(pair_distances(positions), frame_noise(positions))


@pytest.mark.parametrize("noise_m", [3e-4, 6e-4, 2e-3])
def test_the_noise_is_found_from_distances_and_from_frame_to_frame(noise_m):
    positions = hopping(1, n_frames=4000, noise_m=noise_m)[1]
    body = next(c for c in clusters(positions) if 0 in c.markers)
    assert body.noise == pytest.approx(noise_m, rel=0.15)
    # Contacts and the bend of the flight are in it as well.
    np.testing.assert_allclose(frame_noise(positions), noise_m, rtol=0.25)


def test_the_body_is_a_cluster_and_a_fixed_post_is_not_of_it():
    found = [{MARKERS[m] for m in c.markers} for c in clusters(hopping(2)[1])]
    assert {"hip1", "hip2", "hip3"} in found
    assert not any("post" in names for names in found)


def test_markers_that_wander_are_no_cluster():
    walk = np.cumsum(np.random.default_rng(3).normal(0, 0.01, (2000, 5, 3)), axis=0)
    assert clusters(walk) == ()


def test_two_markers_are_no_cluster():
    assert clusters(hopping(4)[1][:, :2]) == ()


def test_a_marker_never_seen_joins_none():
    positions = hopping(5)[1]
    positions[:, 2] = np.nan
    assert all(2 not in c.markers for c in clusters(positions))
    assert np.isnan(frame_noise(positions)[2])
