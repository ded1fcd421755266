"""Files as users have them: every format with every habit, read to the same numbers."""

from collections import Counter

import numpy as np
import pytest
from habits import POSITIONS, RATE, TIME, variants

from hopdata.errors import RecordingError
from hopdata.recordings.raw import METRES_PER_UNIT
from hopdata.recordings.readers.formats import read_raw

MOST_REFUSED = 0.05
ALL = variants()


def read(variant, folder):
    """Read a variant, and check its numbers, names and rate."""
    found = read_raw(variant.file(folder), rate_hz=variant.given_hz)
    assert found.rate_hz == pytest.approx(RATE, rel=1e-6)
    metres = found.positions * METRES_PER_UNIT[found.unit]
    np.testing.assert_allclose(metres, POSITIONS / 1000, atol=2e-5)
    np.testing.assert_allclose(np.diff(found.time), np.diff(TIME), atol=1e-9)
    expected = [
        name for name in variant.names if variant.names.count(name) == 1 and name
    ]
    assert [name for name in found.markers if name in variant.names] == expected
    if len(expected) < len(variant.names):
        assert found.remarks, "names were changed and nothing said"


def test_formats_with_habits_are_read_to_the_same_numbers(tmp_path):
    refused = []
    for number, variant in enumerate(ALL):
        try:
            read(variant, tmp_path / f"{number}")
        except RecordingError as error:
            refused.append((variant.format, variant.habit, str(error)))
        except AssertionError as error:
            raise AssertionError(
                f"{variant.format}, {variant.habit}: {error}"
            ) from error
    print(f"{len(refused)} of {len(ALL)} refused", *refused, sep="\n")
    assert len(ALL) > 300
    assert len(refused) < MOST_REFUSED * len(ALL), Counter(
        kind for kind, _, _ in refused
    )
