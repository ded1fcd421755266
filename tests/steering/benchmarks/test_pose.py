import numpy as np
from pose import twists

from hopdata.scenes.body import rotation_matrices


def test_the_twist_is_off_by_half_of_pitch_times_roll():
    angles = np.array([[0.7, 0.02, 0.03], [0.7, -0.02, 0.03]])
    error = twists(rotation_matrices(angles)) - 0.7
    np.testing.assert_allclose(error, -0.5 * angles[:, 1] * angles[:, 2], atol=1e-6)
