"""What names of feet tell of their sides."""

import pytest

from hopdata.recordings.quality.part_names import sides_of_feet


@pytest.mark.parametrize(
    "names",
    [
        ("LF", "RF", "LH", "RH"),
        ("LF_TOE", "RF_TOE", "LH_TOE", "RH_TOE"),
        ("LFHOOF", "RFHOOF", "LHHOOF", "RHHOOF"),
        ("LFP", "RFP", "LHP", "RHP"),
        ("FL", "FR", "HL", "HR"),
        ("FL_Paw", "FR_Paw", "RL_Paw", "RR_Paw"),
        ("LF", "RH"),
        ("LHEE", "RHEE", "LTOE", "RTOE"),
    ],
)
def test_limbs_of_an_animal_have_the_side_of_their_names(names):
    is_last = names[0].startswith("F")
    expected = [name[1 if is_last else 0].lower() for name in names]
    assert list(sides_of_feet(names)) == expected


@pytest.mark.parametrize(
    "names",
    [
        ("LF_TOE",),  # one foot alone
        ("LF_TOE", "LH_TOE"),  # one side alone
        ("LF_TOE", "RF_TOE", "FOOT3"),
        ("LFRAME", "RFRAME"),
        ("FL", "RF"),  # two ways of naming
        ("RHIP1", "LHIP1"),
        ("foot1", "foot2"),
    ],
)
def test_other_names_tell_no_side(names):
    assert set(sides_of_feet(names)) == {""}


def test_a_heel_is_no_hind_foot():
    assert sides_of_feet(("LHEE", "RHEE")) == ("l", "r")
    assert sides_of_feet(("LHEE", "RF_TOE")) == ("l", "")
