"""What the contact instants' own errors leave of the share that the inputs foretell."""

import numpy as np
import pytest

from hopdata.maps.verdict.expected import expected_contacts


@pytest.mark.parametrize("feet", [2, 3, 5])
def test_errors_of_the_instants_count_as_neither_foretold_nor_missed(feet):
    """Of instants about their mean, three parts have known sizes."""
    rng = np.random.default_rng(3)
    x = rng.standard_normal((4000, 8))
    onto = rng.standard_normal((8, feet))
    explained = x @ (onto / np.linalg.norm(onto, axis=0))
    posture = 0.5 * rng.standard_normal(explained.shape)
    error = 0.6
    instants = explained + posture + error * rng.standard_normal(explained.shape)

    def size(values):
        return np.mean((values - values.mean(axis=1, keepdims=True)) ** 2)

    found = expected_contacts(x, instants)
    plain = found.foretold()
    beside_errors = found.foretold(np.full(instants.shape, error))
    whole = size(explained) + size(posture)
    assert plain == pytest.approx(size(explained) / size(instants), abs=0.05)
    assert beside_errors == pytest.approx(size(explained) / whole, abs=0.05)
    # Errors as large as the instants vary leave nothing to foretell.
    assert found.foretold(3.0 * np.abs(instants)) == 0.0
    np.testing.assert_allclose(found.instants.mean(axis=1), 0.0, atol=1e-12)
