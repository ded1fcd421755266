import numpy as np
import pytest

from hopdata.synthesis.gaps import draw_gaps
from hopdata.synthesis.options import GapOptions


def drawn(options, frames=200_000, seed=1):
    return draw_gaps(
        options, frames=frames, markers=3, rate_hz=100.0, rng=np.random.default_rng(seed)
    )


def test_no_gaps_unless_asked_for():
    assert not drawn(GapOptions()).any()


def test_rate_and_length_are_as_asked():
    hidden = drawn(GapOptions(rate_per_min=3.0, mean_s=0.08))
    begins = np.diff(hidden.astype(int), axis=0, prepend=0) == 1
    minutes = 200_000 / 100 / 60
    assert begins.sum() / (3 * minutes) == pytest.approx(3.0, rel=0.1)
    assert hidden.sum() / begins.sum() / 100 == pytest.approx(0.08, rel=0.15)


def test_markers_are_hidden_independently_and_reproducibly():
    options = GapOptions(rate_per_min=3.0)
    hidden = drawn(options)
    assert (hidden[:, 0] & hidden[:, 1]).mean() < 0.2 * hidden[:, 0].mean()
    np.testing.assert_array_equal(hidden, drawn(options))
    assert np.any(hidden != drawn(options, seed=2))
