import pytest

from hopdata.recordings.quality.part_names import HEEL
from hopdata.recordings.quality.vocabulary import named_parts


def both(forms, sides="LR"):
    """Return names for both sides: `@` stands for the side."""
    names = []
    for form in forms.split():
        names += [form.replace("@", side) for side in sides] if "@" in form else [form]
    return tuple(names)


# Marker sets as laboratories and programs name them, and their markers on feet.
SETS = {
    "Plug-in Gait": (
        both("@FHD @BHD C7 T10 CLAV STRN RBAK @SHO @ELB @WRA @FIN @ASI @PSI @THI @KNE @TIB"
             " @ANK @HEE @TOE"),
        both("@HEE @TOE"),
    ),
    "with a subject": (
        both("Anna:@ASI Anna:@KNE Anna:@ANK Anna:@TIB Anna:@HEE Anna:@TOE"),
        both("Anna:@HEE Anna:@TOE"),
    ),
    "with a trial": (
        both("251112_KUO_@ASI 251112_KUO_@KNE 251112_KUO_@TIB 251112_KUO_@HEE"),
        both("251112_KUO_@HEE"),
    ),
    "Rizzoli": (
        both("@ASIS @PSIS @GT @LE @ME @HF @TT @LM @MM @CA @FM @SM @VM"),
        both("@CA @FM @SM @VM"),
    ),
    "van Sint Jan": (
        both("SJN SXS CV7 TV2 @IAS @IPS @HLE @USP @FTC @FLE @FME @TTC @FAX @FAL @TAM"
             " @FCC @FM1 @FM2 @FM5"),
        both("@FCC @FM1 @FM2 @FM5"),
    ),
    "hands and feet": (  # FT3 is a finger here
        both("HV OCC SEL C7 SUP STR @A @LHE @MHE @US @RS @HMH5 @FT3 @ASIS @LFE @MFE @LM"
             " @SPH @CAL @MFH5 @MFH1 @TT2 @ATT"),
        both("@CAL @MFH5 @MFH1 @TT2"),
    ),
    "clusters": (  # and a foot's here
        both("@PV1 @TH1 @TH2 @SK1 @SK2 @FT1 @FT2 @FT3"),
        both("@FT1 @FT2 @FT3"),
    ),
    "OpenCap": (
        both("C7 @.ASIS @.PSIS @_Shoulder @_knee @_sh2 @_thigh1 @_ankle @_5meta @_calc"
             " @_toe @_wrist_ulna", "Lr"),
        both("@_5meta @_calc @_toe", "Lr"),
    ),
    "Kinect": (
        both("Head SpineBase Shoulder@ Elbow@ Wrist@ Finger@ Hip@ Knee@ Ankle@ Foot@",
             ("Left", "Right")),
        both("Foot@", ("Left", "Right")),
    ),
    "MediaPipe": (
        both("nose @_eye @_shoulder @_elbow @_wrist @_index @_hip @_knee @_ankle @_heel"
             " @_foot_index", ("left", "right")),
        both("@_heel @_foot_index", ("left", "right")),
    ),
    "French": (
        both("tete bassin epaule_@ genou_@ cheville_@ talon_@ orteil_@",
             ("gauche", "droit")),
        both("talon_@ orteil_@", ("gauche", "droit")),
    ),
    "German": (
        both("Kopf Becken Schulter_@ Knie_@ Ferse_@ Zehe_@", ("links", "rechts")),
        both("Ferse_@ Zehe_@", ("links", "rechts")),
    ),
    "Portuguese": (
        both("cabeca ombro_@ quadril_@ joelho_@ tornozelo_@ calcanhar_@",
             ("esquerdo", "direito")),
        both("calcanhar_@", ("esquerdo", "direito")),
    ),
    "a horse": (
        both("Withers Croup @FrontHoof @FrontFetlock @BackHoof @BackHock"),
        both("@FrontHoof @BackHoof"),
    ),
}  # fmt: skip


@pytest.mark.parametrize("marker_set", SETS)
def test_the_feet_of_a_vocabulary_are_known_and_nothing_else(marker_set):
    names, feet = SETS[marker_set]
    found = named_parts(names)
    assert {names[m] for m in found.feet} == set(feet)
    assert found.settles_feet
    assert found.is_animal == (marker_set == "a horse")
    for m in found.feet:
        assert found.sides[m] in ("l", "r")
        pairs = [k for k in found.feet if found.stems[k] == found.stems[m]]
        assert len(pairs) == 2, "one of each side"


def test_one_code_alone_means_nothing():
    alone = named_parts(("RA", "LA", "box1", "box2"))
    assert alone.parts == ("",) * 4
    assert not alone.is_human
    assert not alone.settles_feet


def test_a_robot_lands_on_its_fingers_and_a_person_does_not():
    robot = named_parts(("body1", "body2", "finger1", "finger2"))
    assert [robot.role(m) for m in range(4)] == ["body", "body", "foot", "foot"]
    assert not robot.is_human
    person = named_parts(("head", "pelvis", "LShoulder", "finger1", "LHeel", "RHeel"))
    assert person.is_human
    assert person.role(3) == "other"


def test_what_a_program_computed_is_no_foot():
    names = both("@ASI @PSI @KNE @TIB @ANK @HEE @TOE @FOA @TOO @FEP PELO HEDO")
    found = named_parts(names)
    assert {names[m] for m in found.feet} == {*both("@HEE @TOE")}
    assert found.parts[names.index("PELO")] == "virtual"


def test_heels_have_the_first_place_on_either_side():
    names = both("@ASIS @PSIS @LE @ME @HF @LM @CA @FM")
    found = named_parts(names)
    left, right = (found.place(names.index(name)) for name in ("LCA", "RCA"))
    assert left == right
    assert left[0] == HEEL
    assert found.place(names.index("LFM"))[0] != HEEL
