"""Simple made-up jumps: two feet with heels and toes, shanks, a pelvis and a head."""

import numpy as np

# Names of the pelvis (4), then for each side heel, toe, first and fifth metatarsal,
# ankle, knee; then the head.
STYLES = {
    "plug-in gait": (
        *("LASI", "RASI", "LPSI", "RPSI"),
        *("LHEE", "LTOE", "LMT1", "LMT5", "LANK", "LKNE"),
        *("RHEE", "RTOE", "RMT1", "RMT5", "RANK", "RKNE"),
        "C7",
    ),
    "qtm": (
        *("L_IAS", "R_IAS", "L_IPS", "R_IPS"),
        *("L_FCC", "L_TOE", "L_FM1", "L_FM5", "L_FAL", "L_FLE"),
        *("R_FCC", "R_TOE", "R_FM1", "R_FM5", "R_FAL", "R_FLE"),
        "CV7",
    ),
    "opensim": (
        *("L.ASIS", "R.ASIS", "L.PSIS", "R.PSIS"),
        *("L.Heel", "L.Toe.Tip", "L.MT1", "L.MT5", "L.Ankle.Lat", "L.Knee.Lat"),
        *("R.Heel", "R.Toe.Tip", "R.MT1", "R.MT5", "R.Ankle.Lat", "R.Knee.Lat"),
        "Top.Head",
    ),
    "small letters": (
        *("l_asis", "r_asis", "l_psis", "r_psis"),
        *("l_heel", "l_toe", "l_mt1", "l_mt5", "l_ankle", "l_knee"),
        *("r_heel", "r_toe", "r_mt1", "r_mt5", "r_ankle", "r_knee"),
        "head",
    ),
    "words": (
        *("PelvisFrontLeft", "PelvisFrontRight", "PelvisBackLeft", "PelvisBackRight"),
        *("LeftHeel", "LeftToe", "LeftFootIn", "LeftFootOut", "LeftAnkle", "LeftKnee"),
        *(
            "RightHeel",
            "RightToe",
            "RightFootIn",
            "RightFootOut",
            "RightAnkle",
            "RightKnee",
        ),
        "HeadTop",
    ),
    "numbers": tuple(f"M{k:03d}" for k in range(1, 18)),
}
PELVIS = np.array(
    [[0.1, 0.13, 1.0], [0.1, -0.13, 1.0], [-0.1, 0.05, 1.02], [-0.1, -0.05, 1.02]]
)
# Positions for the left side, from the middle of the foot: x forward, y outward, z at
# rest.
FOOT = np.array(
    [
        [-0.1, 0, 0.04],
        [0.16, 0, 0.035],
        [0.1, -0.04, 0.03],
        [0.08, 0.05, 0.025],
        [-0.05, 0.04, 0.09],
    ]
)
PITCH_ABOUT = 0.1  # position of the ball of the foot, about which the heel is lifted
GRAVITY = 9.81


def jumping(seed, *, jumps=1, rate_hz=100.0, noise_m=5e-4):
    """Return positions (N, 17, 3), m, z up: standing, crouch, flight, landing, `jumps` times."""
    rng = np.random.default_rng(seed)
    body, lift, heel = [], [], []
    for _ in range(jumps):
        for height, flight, pitch in _one_jump(rng, 1 / rate_hz):
            body.append(height)
            lift.append(flight)
            heel.append(pitch)
    stand = np.zeros(int(rng.uniform(0.8, 2.0) * rate_hz))
    body, lift, heel = (np.concatenate([*part, stand]) for part in (body, lift, heel))
    sway = _sway(rng, len(body), rate_hz)
    forward = np.cumsum(np.where(lift > 0, 0.3 / rate_hz, 0.0))
    positions = np.empty((len(body), 17, 3))
    for m, place in enumerate(PELVIS):
        positions[:, m] = place + sway
        positions[:, m, 0] += forward
        positions[:, m, 2] += body
    late = rng.integers(0, 3, 2)  # frames by which one foot lands after the other
    for side, sign in enumerate((1, -1)):
        first = 4 + 6 * side
        up = np.maximum(0, lift - 0.02 * late[side] * (lift > 0))
        angle = heel * rng.uniform(0.9, 1.1)
        for k, place in enumerate(FOOT):
            along = place[0] - PITCH_ABOUT
            raised = np.maximum(0.0, -along * np.sin(angle))
            positions[:, first + k, 0] = PITCH_ABOUT + along * np.cos(angle) + forward
            positions[:, first + k, 1] = sign * (0.12 + place[1])
            positions[:, first + k, 2] = place[2] + up + raised
        positions[:, first + 5, 0] = 0.05 + forward - 0.2 * np.minimum(body, 0.0)
        positions[:, first + 5, 1] = sign * 0.13
        positions[:, first + 5, 2] = 0.5 + np.where(
            lift > 0, lift, 0.4 * np.minimum(body, 0.0)
        )
    positions[:, 16] = np.array([-0.05, 0.0, 1.5]) + 1.4 * sway
    positions[:, 16, 0] += forward
    positions[:, 16, 2] += 1.05 * body
    return positions + rng.normal(0, noise_m, positions.shape)


def _one_jump(rng, step):
    """Return heights of the body and of the feet, and the pitch of the feet, part by part."""
    depth, flight = rng.uniform(0.2, 0.3), step * round(rng.uniform(0.4, 0.55) / step)
    speed = 0.5 * GRAVITY * flight

    def times(seconds):
        return step * np.arange(round(seconds / step))

    stand = times(rng.uniform(0.7, 2.0))
    yield np.zeros(len(stand)), np.zeros(len(stand)), np.zeros(len(stand))
    down = times(rng.uniform(0.4, 0.6))
    yield -depth * np.sin(0.5 * np.pi * down / down[-1]) ** 2, 0 * down, 0 * down
    toe_off, push = (
        0.1,
        0.3,
    )  # rise of the body on its toes above standing, m; duration, s
    rise = times(push)
    s = rise / push
    height = -depth + (toe_off + depth) * s ** (speed * push / (toe_off + depth))
    yield height, 0 * rise, 0.6 * np.maximum(0, (s - 0.5) / 0.5) ** 2
    fly = times(flight)
    above = speed * fly - 0.5 * GRAVITY * fly**2
    tucked = np.minimum(
        fly / 0.12, 1.0
    )  # legs leave the floor more slowly than the body
    lift = np.maximum(above, 1e-6) * tucked**2 * (3 - 2 * tucked)
    yield toe_off + above, lift, 0.6 - 0.3 * fly / flight
    land, sink = times(0.8), rng.uniform(0.08, 0.12)
    height = (toe_off + (toe_off / sink - speed) * land) * np.exp(-land / sink)
    yield height, 0 * land, 0.3 * np.maximum(0.0, 1 - land / 0.06)


def _sway(rng, n, rate_hz):
    phase, time_scale = rng.uniform(0, 2 * np.pi, 3), rng.uniform(0.2, 0.5, 3)
    time = np.arange(n)[:, None] / rate_hz
    return np.array([0.01, 0.01, 0.002]) * np.sin(2 * np.pi * time_scale * time + phase)
