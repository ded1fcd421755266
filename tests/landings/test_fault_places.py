"""Faults of markers are told as lying at contacts or between them."""

import numpy as np
import pandas as pd
import pytest

from hopdata.landings.fault_places import AT_CONTACT_S, are_at_contacts, fault_places

CONTACTS_S = np.arange(1.0, 11.0)


def jumps(times_s, recording="r"):
    return pd.DataFrame(
        {"recording": recording, "kind": "jump", "marker": "toe", "start_s": times_s}
    )


def landings(recording="r"):
    return pd.DataFrame(
        {
            "recording": recording,
            "contact_toe_s": CONTACTS_S,
            "contact_heel_s": [np.nan] * len(CONTACTS_S),
        }
    )


@pytest.mark.parametrize(("off_s", "at"), [(0.5 * AT_CONTACT_S, 10), (0.4, 0)])
def test_faults_at_contacts_are_told_from_those_between(off_s, at):
    found = fault_places(jumps(CONTACTS_S + off_s), landings())
    assert (found.values["at"], found.values["between"]) == (at, 10 - at)
    first = f"toe at {1 + off_s:.2f} s, toe at {2 + off_s:.2f} s"
    assert found.values["first"].startswith(first)
    assert found.values["first"].endswith(", and 7 more")
    assert f"{at} at a contact (within 50 ms), {10 - at} between" in str(found)


def test_the_window_is_as_wide_as_stated():
    off_s = np.array([0.9, 1.1]) * AT_CONTACT_S
    assert are_at_contacts(1.0 + off_s, np.array([1.0, np.nan])).tolist() == [1, 0]


def test_times_of_faults_count_from_the_first_frame():
    started = {"r": 0.5}
    late = fault_places(jumps(CONTACTS_S - 0.5), landings(), started)
    assert late.values["at"] == 10
    assert fault_places(jumps(CONTACTS_S - 0.5), landings()).values["at"] == 0


def test_contacts_of_another_recording_do_not_count():
    of_both = pd.concat([jumps([1.0]), jumps([1.5], "q")])
    found = fault_places(of_both, landings())
    assert (found.values["at"], found.values["between"]) == (1, 1)
    assert found.values["first"] == "toe at 1.00 s of r, toe at 1.50 s of q"


def test_a_swap_of_two_markers_counts_once_and_time_stamps_do_not():
    swap = pd.DataFrame(
        {"recording": "r", "kind": "swap", "marker": ["toe", "heel"], "start_s": 1.0}
    )
    found = fault_places(swap, landings())
    assert (found.values["at"], found.values["between"]) == (1, 0)
    assert found.values["first"] == "toe and heel at 1.00 s"
    assert fault_places(swap.assign(marker=""), landings()) is None
    assert fault_places(swap, landings().assign(contact_toe_s=np.nan)) is None
