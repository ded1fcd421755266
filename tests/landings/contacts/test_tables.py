"""The table of landings: which marker of a foot is first, by one row or another."""

import numpy as np
import pytest

from hopdata.landings.contacts.judged import Contacts
from hopdata.landings.contacts.steps import NO_OTHER
from hopdata.landings.contacts.tables import _of_either


@pytest.mark.parametrize(("of_other", "expected"), [(1, 0.7), (0, 0.45)])
def test_a_marker_is_half_as_sure_where_another_row_tells_of_another(
    of_other, expected
):
    """Both rows tell of a contact, and either may be the foot's."""
    contacts = Contacts(
        instant=np.array([[1.0], [1.004], [2.0]]),
        se=np.full((3, 1), 0.001),
        status=np.zeros((3, 1), np.int64),
        noise_m=0.001,
        marker=np.array([[of_other], [1], [1]]),
        marker_probability=np.array([[0.5], [0.9], [0.8]]),
    )
    other = np.array([[NO_OTHER], [0], [NO_OTHER]])
    found = _of_either(contacts, other)
    np.testing.assert_allclose(found, [[0.5], [expected], [0.8]])
