import numpy as np
import pytest

from hopdata.maps.subspaces.baselines import (
    PRINTED_READING,
    READINGS,
    Reading,
    noised_identities,
    noised_identity,
    random,
)


def test_haar_and_noised_identity_of_seventeen_in_thirty_four():
    haar = random(np.random.default_rng(0), (34, 17), 4000)
    noised = noised_identity(np.random.default_rng(1), (34, 17), 4000, 0.1)
    # Standard error of the mean 0.0016, of the sd 1.1 %.
    assert haar.mean() == pytest.approx(3.7605, abs=0.006)
    assert haar.std() == pytest.approx(0.102, rel=0.05)
    assert noised.mean() == pytest.approx(2.268, abs=0.006)
    assert noised.std() == pytest.approx(0.098, rel=0.05)


def test_the_ratio_of_a_reading_is_ten():
    shape = (34, 17)
    for reading in READINGS:
        noise = reading.noise_sd(shape) * np.random.default_rng(2).normal(size=(400, *shape))
        identity = np.eye(*shape)
        signal = 1.0 if reading.signal == "entry" else np.linalg.norm(identity) ** 2
        power = (
            np.mean(noise**2) if reading.signal == "entry" else np.mean(np.sum(noise**2, (1, 2)))
        )
        ratio = signal / power
        assert (ratio**0.5 if reading.ratio == "amplitude" else ratio) == pytest.approx(
            10, rel=0.01
        )


def test_the_printed_reading_is_one_of_them():
    assert PRINTED_READING in READINGS
    assert len(set(READINGS)) == 8
    assert Reading("amplitude", "entry", 2) == PRINTED_READING
    assert PRINTED_READING.noise_sd((34, 17)) == 0.1


def test_only_as_many_as_are_said_have_noise():
    identity = np.eye(9, 4)
    a, b = noised_identities(np.random.default_rng(3), (9, 4), 5, 0.1, noised=1)
    np.testing.assert_allclose(np.abs(b), np.broadcast_to(identity, (5, 9, 4)))
    assert np.abs(np.abs(a) - identity).max() > 0.05
