"""Made-up people and animals who walk, stand, sit, jump or lie, in any marker set.

Each landmark sits on a segment of a chain of joints, with proportions of anthropometric
tables; a marker set gives landmarks the names of a vocabulary.
"""

from dataclasses import dataclass

import numpy as np

from hopdata.recordings.axes import rotate_up

# Landmarks: segment, and place on it (forward, outward, up from its upper joint),
# relative to the stature.
LANDMARKS = {
    "heel": ("foot", (-0.035, 0.0, -0.025)),
    "toe": ("foot", (0.10, 0.0, -0.030)),
    "mt1": ("foot", (0.08, -0.02, -0.030)),
    "mt5": ("foot", (0.065, 0.03, -0.033)),
    "ankle": ("foot", (0.0, 0.02, 0.0)),
    "ankle_in": ("foot", (0.0, -0.02, 0.005)),
    "shank": ("shank", (0.01, 0.03, -0.12)),
    "shank_low": ("shank", (0.02, 0.02, -0.18)),
    "tuberosity": ("shank", (0.025, 0.0, -0.04)),
    "fibula": ("shank", (-0.01, 0.03, -0.03)),
    "knee": ("shank", (0.0, 0.03, 0.0)),
    "knee_in": ("shank", (0.0, -0.03, 0.0)),
    "thigh": ("thigh", (0.02, 0.045, -0.13)),
    "thigh_low": ("thigh", (0.03, 0.03, -0.18)),
    "trochanter": ("thigh", (0.0, 0.05, 0.0)),
    "asis": ("pelvis", (0.05, 0.075, 0.04)),
    "psis": ("pelvis", (-0.06, 0.03, 0.05)),
    "crest": ("pelvis", (0.0, 0.08, 0.07)),
    "sacrum": ("pelvis", (-0.065, 0.0, 0.04)),
    "t10": ("trunk", (-0.06, 0.0, 0.17)),
    "sternum": ("trunk", (0.08, 0.0, 0.19)),
    "clavicle": ("trunk", (0.05, 0.0, 0.28)),
    "c7": ("trunk", (-0.03, 0.0, 0.33)),
    "shoulder": ("trunk", (0.0, 0.11, 0.30)),
    "head_front": ("trunk", (0.06, 0.04, 0.42)),
    "head_back": ("trunk", (-0.05, 0.04, 0.42)),
    "head_top": ("trunk", (0.0, 0.0, 0.47)),
    "nose": ("trunk", (0.08, 0.0, 0.40)),
    "upper_arm": ("arm", (0.0, 0.02, -0.09)),
    "elbow": ("arm", (0.0, 0.02, -0.18)),
    "forearm": ("forearm", (0.0, 0.02, -0.07)),
    "wrist": ("forearm", (0.0, 0.02, -0.14)),
    "wrist_in": ("forearm", (0.02, -0.01, -0.14)),
    "hand": ("forearm", (0.0, 0.01, -0.19)),
}
OF_FEET = ("heel", "toe", "mt1", "mt5")
IN_THE_MIDDLE = ("sacrum", "t10", "sternum", "clavicle", "c7", "head_top", "nose")

HIP_HEIGHT, THIGH, SHANK, ANKLE_HEIGHT = 0.53, 0.245, 0.246, 0.039
HALF_PELVIS, HALF_STANCE = 0.05, 0.055

# Names of landmarks in marker sets; `{S}` is L or R, `{s}` is l or r.
MARKER_SETS = {
    "Plug-in Gait": (
        "heel {S}HEE|toe {S}TOE|ankle {S}ANK|shank {S}TIB|knee {S}KNE|thigh {S}THI|"
        "asis {S}ASI|psis {S}PSI|t10 T10|sternum STRN|clavicle CLAV|c7 C7|"
        "shoulder {S}SHO|head_front {S}FHD|head_back {S}BHD|upper_arm {S}UPA|"
        "elbow {S}ELB|forearm {S}FRM|wrist {S}WRA|wrist_in {S}WRB|hand {S}FIN"
    ),
    "Plug-in Gait, legs": (
        "heel {S}HEE|toe {S}TOE|ankle {S}ANK|shank {S}TIB|knee {S}KNE|thigh {S}THI|"
        "asis {S}ASI|sacrum SACR"
    ),
    "Rizzoli": (
        "heel {S}CA|mt1 {S}FM|mt5 {S}VM|toe {S}SM|ankle {S}LM|ankle_in {S}MM|"
        "fibula {S}HF|tuberosity {S}TT|knee {S}LE|knee_in {S}ME|trochanter {S}GT|"
        "asis {S}ASIS|psis {S}PSIS"
    ),
    "clusters": (
        "heel {S}FT1|mt1 {S}FT2|mt5 {S}FT3|shank {S}SK1|shank_low {S}SK2|"
        "fibula {S}SK3|thigh {S}TH1|thigh_low {S}TH2|trochanter {S}TH3|asis {S}PV1|"
        "psis {S}PV2"
    ),
    "Qualisys": (
        "heel {S}_FCC|mt1 {S}_FM1|mt5 {S}_FM5|ankle {S}_FAL|ankle_in {S}_TAM|"
        "tuberosity {S}_TTC|fibula {S}_FAX|knee {S}_FLE|knee_in {S}_FME|asis {S}_IAS|"
        "psis {S}_IPS|sternum SXS|c7 CV7|shoulder {S}_SAE|elbow {S}_HLE"
    ),
    "Qualisys sports": (
        "heel {S}HeelBack|mt1 {S}ForefootIn|mt5 {S}ForefootOut|toe {S}ToeTip|"
        "ankle {S}AnkleOut|shank {S}ShinFrontHigh|knee {S}KneeOut|"
        "thigh {S}ThighFrontLow|asis Waist{S}Front|sacrum WaistBack|sternum Chest|"
        "c7 SpineTop|shoulder {S}ShoulderTop|elbow {S}ElbowOut|wrist {S}WristOut|"
        "hand {S}HandOut|head_front Head{S}"
    ),
    "OpenSim": (
        "heel {S}.Heel|toe {S}.Toe.Tip|mt5 {S}.Midfoot.Lat|shank {S}.Shank.Front|"
        "thigh {S}.Thigh.Front|asis {S}.ASIS|sacrum V.Sacral|sternum Sternum|"
        "shoulder {S}.Acromium|head_top Top.Head"
    ),
    "OpenSim, clusters": (
        "heel {S}CAL|toe {S}TOE|mt5 {S}MT5|ankle {S}LMAL|ankle_in {S}MMAL|"
        "shank {S}TB1|shank_low {S}TB2|knee {S}LFC|knee_in {S}MFC|thigh {S}TH1|"
        "thigh_low {S}TH2|asis {S}ASI|psis {S}PSI|c7 C7|clavicle CLAV|shoulder {S}ACR"
    ),
    "MediaPipe": (
        "heel {side}_heel|toe {side}_foot_index|ankle {side}_ankle|knee {side}_knee|"
        "trochanter {side}_hip|shoulder {side}_shoulder|elbow {side}_elbow|"
        "wrist {side}_wrist|hand {side}_index|nose nose|head_front {side}_eye"
    ),
    "OpenPose": (
        "heel {S}Heel|toe {S}BigToe|mt5 {S}SmallToe|ankle {S}Ankle|knee {S}Knee|"
        "trochanter {S}Hip|shoulder {S}Shoulder|elbow {S}Elbow|wrist {S}Wrist|"
        "sacrum MidHip|c7 Neck|nose Nose"
    ),
    "French": (
        "heel talon_{side_fr}|toe orteil_{side_fr}|ankle cheville_{side_fr}|"
        "knee genou_{side_fr}|trochanter hanche_{side_fr}|sacrum bassin|"
        "shoulder epaule_{side_fr}|elbow coude_{side_fr}|wrist poignet_{side_fr}|"
        "head_top tete"
    ),
    "German": (
        "heel Ferse_{side_de}|toe Zehe_{side_de}|ankle Sprunggelenk_{side_de}|"
        "knee Knie_{side_de}|trochanter Huefte_{side_de}|sacrum Becken|"
        "shoulder Schulter_{side_de}|elbow Ellenbogen_{side_de}|head_top Kopf"
    ),
    "Portuguese": (
        "heel calcanhar_{side_pt}|toe halux_{side_pt}|ankle tornozelo_{side_pt}|"
        "knee joelho_{side_pt}|trochanter quadril_{side_pt}|shoulder ombro_{side_pt}|"
        "elbow cotovelo_{side_pt}|wrist punho_{side_pt}|head_top cabeca"
    ),
}
_SIDE_WORDS = {
    "l": {
        "side": "left",
        "side_fr": "gauche",
        "side_de": "links",
        "side_pt": "esquerdo",
    },
    "r": {
        "side": "right",
        "side_fr": "droit",
        "side_de": "rechts",
        "side_pt": "direito",
    },
}
POSTURES = ("walk", "treadmill", "run", "jump", "stand", "sit", "squat", "stoop", "lie")


@dataclass(frozen=True)
class Person:
    """A made-up recording of a person, and what is true of it.

    Parameters
    ----------
    names : tuple of str
        The M names.
    positions : (N, M, 3) array
        In m, z up.
    rate_hz : float
        Frame rate, Hz.
    feet : frozenset of str
        Names of the markers on feet.
    landmarks : tuple of str
        The landmark of each marker.
    """

    names: tuple[str, ...]
    positions: np.ndarray
    rate_hz: float
    feet: frozenset[str]
    landmarks: tuple[str, ...]


def person(seed, posture, marker_set, *, seconds=3.0, rate_hz=100.0):
    """Return a made-up `Person` of any size and heading, with some markers missing."""
    rng = np.random.default_rng(
        np.random.SeedSequence([20261128, *np.atleast_1d(seed)])
    )
    stature_m = rng.uniform(1.1, 2.0)
    time = np.arange(round(seconds * rate_hz)) / rate_hz
    joints = _joints(posture, time, rng)
    names = []
    columns = []
    feet = []
    landmarks = []
    for entry in MARKER_SETS[marker_set].split("|"):
        landmark, form = entry.split(" ", 1)
        is_single = landmark in IN_THE_MIDDLE or landmark == "sacrum"
        for side in ("l",) if is_single else ("l", "r"):
            name = form.format(S=side.upper(), s=side, **_SIDE_WORDS[side])
            names.append(name)
            columns.append(_marker(joints, landmark, side, is_single, rng))
            landmarks.append(landmark)
            if landmark in OF_FEET:
                feet.append(name)
    positions = stature_m * np.stack(columns, axis=1)
    positions = _turned_about_z(positions, rng.uniform(0, 2 * np.pi))
    positions += rng.uniform(-2, 2, 3) * [1, 1, 0]
    positions += rng.normal(0, 5e-4, positions.shape)
    kept = rng.random(len(names)) > 0.06
    return Person(
        tuple(name for name, keep in zip(names, kept, strict=True) if keep),
        positions[:, kept],
        rate_hz,
        frozenset(feet),
        tuple(mark for mark, keep in zip(landmarks, kept, strict=True) if keep),
    )


def _turned_about_z(positions, angle):
    cos, sin = np.cos(angle), np.sin(angle)
    return positions @ np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1.0]])


def in_file(positions, up):
    """Turn positions with z up into those of a file in which `up` points up."""
    return positions @ np.linalg.inv(rotate_up(np.eye(3), up))


def _pitched(angle):
    """Return rotations (N, 3, 3) by an angle (N,) forwards in the sagittal plane."""
    cos, sin = np.cos(angle), np.sin(angle)
    zero, one = np.zeros_like(cos), np.ones_like(cos)
    rows = [[cos, zero, sin], [zero, one, zero], [-sin, zero, cos]]
    return np.moveaxis(np.array([[*row] for row in rows]), -1, 0)


def _joints(posture, time, rng):
    """Return the place (N, 3) and rotation of each segment, stature 1, x forward."""
    n = len(time)
    period = {"run": 0.7, "jump": 1.5, "squat": 2.2}.get(posture, rng.uniform(1.0, 1.3))
    phase = 2 * np.pi * time / period + rng.uniform(0, 2 * np.pi)
    lean = np.full(n, rng.uniform(-0.05, 0.1))
    hips = {}
    knees = {}
    sides = {"l": 0.0, "r": np.pi}
    for side, shift in sides.items():
        hip = np.zeros(n)
        knee = np.full(n, 0.05)
        if posture in ("walk", "treadmill", "run"):
            size = 0.45 if posture != "run" else 0.65
            hip = size * np.sin(phase + shift) + 0.1
            bend = 1.0 if posture != "run" else 1.7
            knee = 0.1 + bend * np.clip(np.cos(phase + shift), 0, 1) ** 2
        elif posture == "sit":
            hip += rng.uniform(1.4, 1.6)
            knee += rng.uniform(1.4, 1.6)
        elif posture == "squat":
            depth = 0.5 * (1 - np.cos(phase))
            hip = 1.2 * depth
            knee = 1.5 * depth
        elif posture == "jump":
            in_air, crouch, _ = _jump(time, period)
            hip = 0.8 * crouch + 0.1 * in_air
            knee = 1.4 * crouch + 0.1
        hips[side] = hip
        knees[side] = knee
    if posture == "stoop":
        lean = lean + rng.uniform(0.7, 1.2)
    if posture == "squat":
        lean = lean + 0.6 * hips["l"]
    joints = _chain(lean, hips, knees, posture, phase, rng)
    lowest = np.min(
        [joints["foot", side][0][:, 2] - ANKLE_HEIGHT for side in sides], axis=0
    )
    rise = -lowest
    if posture == "run":
        flight = np.clip(np.sin(2 * phase), 0, 1)
        rise = rise + 0.04 * flight
    if posture == "jump":
        rise = rise + _jump(time, period)[2]
    shift = np.zeros((n, 3))
    shift[:, 2] = rise
    if posture == "walk":
        shift[:, 0] = _forward(joints, rise)
    moved = {key: (place + shift, turn) for key, (place, turn) in joints.items()}
    if posture == "lie":
        turn = _pitched(np.full(n, -np.pi / 2))
        moved = {
            key: (np.einsum("nij,nj->ni", turn, place), turn @ own)
            for key, (place, own) in moved.items()
        }
    return moved


def _jump(time, period):
    """Return whether in the air, how crouched, and how high, relative to 1.7 m."""
    within = time % period
    flight_s = 0.45
    since = within - 0.7
    in_air = (since > 0) & (since < flight_s)
    height = np.where(in_air, 0.5 * 9.81 * since * (flight_s - since), 0.0) / 1.7
    crouch = np.where(within < 0.7, np.sin(np.pi * within / 0.7), 0.0)
    crouch += np.where(
        since > flight_s,
        0.5 * np.sin(np.pi * (since - flight_s) / (period - 0.7 - flight_s)),
        0.0,
    )
    return in_air.astype(float), np.clip(crouch, 0, 1), height


def _forward(joints, rise):
    """Return how far a walker has come: the lower foot stays in place."""
    left = joints["foot", "l"][0]
    right = joints["foot", "r"][0]
    steps_left = np.diff(left[:, 0])
    steps_right = np.diff(right[:, 0])
    stands_left = left[1:, 2] < right[1:, 2]
    steps = -np.where(stands_left, steps_left, steps_right)
    return np.concatenate([[0.0], np.cumsum(steps)])


def _chain(lean, hips, knees, posture, phase, rng):
    """Return the segments of a body whose pelvis is at the origin."""
    n = len(lean)
    trunk = _pitched(lean)
    joints = {}
    origin = np.zeros((n, 3))
    joints["pelvis", ""] = (origin, _pitched(0.3 * lean))
    joints["trunk", ""] = (origin, trunk)
    arm_swing = 0.3 if posture in ("walk", "treadmill", "run") else 0.05
    abducted = rng.uniform(0.0, 0.08)
    for side, sign in (("l", 1.0), ("r", -1.0)):
        hip = origin + np.array([0.0, sign * HALF_PELVIS, 0.0])
        thigh = _pitched(-hips[side])
        knee = hip + np.einsum("nij,j->ni", thigh, [0.0, sign * 0.004, -THIGH])
        shank = _pitched(-hips[side] + knees[side])
        ankle = knee + np.einsum("nij,j->ni", shank, [0.0, 0.0, -SHANK])
        pitch = -hips[side] + knees[side]
        if posture in ("walk", "treadmill", "run"):
            foot = _pitched(0.6 * np.clip(pitch, 0, 2))
        else:
            foot = _pitched(np.zeros(n))
        shoulder = np.einsum("nij,j->ni", trunk, [0.0, sign * 0.11, 0.29])
        arm = _pitched(arm_swing * np.sin(phase + (sign > 0) * np.pi))
        elbow = shoulder + np.einsum("nij,j->ni", arm, [0.0, sign * abducted, -0.18])
        forearm = _pitched(arm_swing * np.sin(phase + (sign > 0) * np.pi) - 0.3)
        joints["thigh", side] = (hip, thigh)
        joints["shank", side] = (knee, shank)
        joints["foot", side] = (ankle, foot)
        joints["arm", side] = (shoulder, arm)
        joints["forearm", side] = (elbow, forearm)
    return joints


def _marker(joints, landmark, side, is_single, rng):
    """Return the place (N, 3) of a landmark, put on a little askew."""
    segment, place = LANDMARKS[landmark]
    sign = 1.0 if side == "l" else -1.0
    local = np.array(place) * [1.0, 0.0 if is_single else sign, 1.0]
    local = local + rng.normal(0, 0.004, 3)
    key = (segment, "" if segment in ("pelvis", "trunk") else side)
    origin, turn = joints[key]
    return origin + np.einsum("nij,j->ni", turn, local)


# Names of an animal's landmarks in marker sets; `{f}` is front or hind.
ANIMAL_SETS = {
    "DeepLabCut, mouse": (
        "paw {side}_{f}_paw|knee {side}_{f}_knee|root spine_{f}|nose nose|"
        "ear {side}_ear|tail tail_base"
    ),
    "DeepLabCut, horse": (
        "paw {S}{F}Hoof|fetlock {S}{F}Fetlock|knee {S}{F}Knee|root {F}Withers|nose Nostril"
    ),
    "limbs": "paw {S}{l}_toe|fetlock {S}{l}_ankle|knee {S}{l}_knee|root {l}_hip|nose head",
}
# Places on an animal of height 1: forward, outward, up; legs are at both ends.
_ANIMAL = {
    "paw": (0.0, 0.12, 0.0),
    "fetlock": (-0.03, 0.13, 0.15),
    "knee": (0.03, 0.14, 0.45),
    "root": (0.0, 0.0, 0.95),
    "nose": (1.2, 0.0, 1.05),
    "ear": (0.95, 0.1, 1.15),
    "tail": (-0.7, 0.0, 0.9),
}


def animal(seed, marker_set, *, seconds=4.0, rate_hz=100.0):
    """Return a made-up animal on four legs that trots on a treadmill, as a `Person`."""
    rng = np.random.default_rng(np.random.SeedSequence([4, *np.atleast_1d(seed)]))
    time = np.arange(round(seconds * rate_hz)) / rate_hz
    height_m = float(np.exp(rng.uniform(np.log(0.05), np.log(1.6))))
    phase = 2 * np.pi * time / (0.6 * height_m**0.5) + rng.uniform(0, 2 * np.pi)
    names, columns, feet, landmarks = [], [], [], []
    for entry in ANIMAL_SETS[marker_set].split("|"):
        landmark, form = entry.split(" ", 1)
        for end, at in (("front", 0.6), ("hind", -0.6)):
            for side, sign in (("l", 1.0), ("r", -1.0)):
                words = {"f": end, "F": end.title(), "l": end[0].upper()}
                name = form.format(S=side.upper(), **words, **_SIDE_WORDS[side])
                if name in names:
                    continue
                forward, outward, up = _ANIMAL[landmark]
                if landmark in ("paw", "fetlock", "knee", "root"):
                    forward += at
                swing = np.sin(phase + np.pi * ((side == "l") == (end == "front")))
                place = np.zeros((len(time), 3))
                place += [forward, sign * outward, up]
                if landmark in ("paw", "fetlock", "knee"):
                    share = {"paw": 1.0, "fetlock": 0.8, "knee": 0.4}[landmark]
                    place[:, 0] += 0.25 * share * np.roll(swing, len(time) // 40)
                    place[:, 2] += 0.12 * share * np.clip(swing, 0, 1) ** 2
                else:
                    place[:, 2] += 0.02 * np.sin(2 * phase)
                names.append(name)
                columns.append(place + rng.normal(0, 0.01, 3) * [1, 1, 0.3])
                landmarks.append(landmark)
                if landmark == "paw":
                    feet.append(name)
    positions = height_m * np.stack(columns, axis=1)
    positions = _turned_about_z(positions, rng.uniform(0, 2 * np.pi))
    positions += height_m * rng.normal(0, 5e-4, positions.shape)
    return Person(tuple(names), positions, rate_hz, frozenset(feet), tuple(landmarks))
