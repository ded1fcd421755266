"""Feet that lose part of their speed at once: heights hardly tell, so errors must say so."""

import numpy as np
import pytest
from falling_feet import falls

from hopdata.landings.contacts.timing import find_contacts


def found(feet):
    return find_contacts(
        feet.time,
        feet.heights,
        feet.transitions,
        down_height_m=0.015,
        gravity="learned",
    )


@pytest.mark.parametrize("landings", [20, 80])
@pytest.mark.parametrize(("kept", "compliance_s"), [(0.4, 0.005), (0.3, 0.008)])
def test_the_common_error_states_how_early_such_contacts_are(
    kept, compliance_s, landings
):
    feet = falls(landings, seed=70, compliance_s=compliance_s, kept=kept)
    contacts = found(feet)
    off = np.nanmedian(contacts.instant - feet.contacts, axis=0)
    assert (np.abs(off) < 2 * contacts.common).all()


@pytest.mark.parametrize(("compliance_s", "most_s"), [(0.0, 5e-4), (0.005, 1e-3)])
def test_feet_that_stop_at_once_or_as_soft_ones_pay_little(compliance_s, most_s):
    feet = falls(80, seed=71, compliance_s=compliance_s)
    contacts = found(feet)
    assert np.nanmax(contacts.common) < most_s
    off = np.nanmedian(contacts.instant - feet.contacts, axis=0)
    assert (np.abs(off) < 3 * contacts.common).all()
