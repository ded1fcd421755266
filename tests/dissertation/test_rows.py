import json

import numpy as np
import pytest

from hopdata.dissertation.rows import Agreement, Row, over_seeds
from hopdata.errors import AnalysisError


def test_a_row_is_stored_and_read_again():
    values = {
        "slope": np.array([4.0, 4.25]),
        "count": np.int64(36),
        "holds": np.bool_(True),
        "name": "arc length",
        "orders": ["1-2-3", "2-1-3"],
    }
    row = Row(93, Agreement.PARTLY, values, "why")
    again = Row.from_dict(json.loads(json.dumps(row.to_dict())))
    assert again.item == 93
    assert again.agreement is Agreement.PARTLY
    assert again.reason == "why"
    assert again.values == {**values, "slope": [4.0, 4.25]}
    assert type(again.values["count"]) is int


@pytest.mark.parametrize(
    "value", [np.nan, [1.0, np.inf], np.float32("nan"), None, {"a": 1.0}]
)
def test_what_is_no_number_is_refused_by_name(value):
    row = Row(5, Agreement.AGREES, {"sound": 1.0, "error_mm": value})
    with pytest.raises(AnalysisError, match="row 5, error_mm: expected a"):
        row.to_dict()


def test_each_seed_is_measured_and_a_bad_one_is_named():
    assert over_seeds(lambda seed: seed**2, [2, 3]) == [4, 9]

    def measure(seed):
        if seed == 7:
            raise AnalysisError("too few landings")
        return seed

    with pytest.raises(AnalysisError) as raised:
        over_seeds(measure, [6, 7, 8])
    assert raised.value.__notes__ == ["with the seed 7"]
