"""What nobody chose changes nothing: frame and units of the laboratory, and the order of names.

One small study of two simulated recordings is made once as it is, and once for each
transformation of the data that leaves the animal and its landings as they were.
"""

import os
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

import hopdata as hd

FEET, BODY = ["foot1", "foot2", "foot3"], ["body1", "body2", "body3"]
#: The orders of the feet differ by a true effect, so that no number is zero by chance.
SIMULATED = {"simulation": {"hops": 110, "control": {"coupling": 0.4}}}
CAMERAS = {"motion_capture": {"floor": {"bowl_depth_m": 0.004}}}
QUICK = {
    "prediction": {"bootstraps": 20},
    "subspaces": {"bootstraps": 10},
    "distances": {"pairs": 20},
}
RELATIVE = 1e-6
#: A place 100 km from the laboratory's origin has steps of 1e-11 m, which is all that
#: is lost.
FAR_M = np.array([1e5, -2e5, 0.0])


@dataclass(frozen=True)
class Change:
    """A change of the data that should not matter, and what it does to lengths and times."""

    length: float = 1.0
    time: float = 1.0
    turn: np.ndarray = field(default_factory=lambda: np.eye(3))
    shift_m: np.ndarray = field(default_factory=lambda: np.zeros(3))
    later_s: float = 0.0
    columns: tuple[int, ...] = tuple(range(6))  # order of the markers in the file
    recordings: int = 1  # step through the recordings: -1 lists the last one first

    def of(self, recording):
        """Return the changed recording."""
        positions = self.length * (recording.positions @ self.turn) + self.shift_m
        return replace(
            recording,
            time=self.time * recording.time + self.later_s,
            rate_hz=recording.rate_hz / self.time,
            positions=positions[:, list(self.columns)],
            markers=tuple(recording.markers[k] for k in self.columns),
            roles=tuple(recording.roles[k] for k in self.columns),
        )


def turned(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


UNCHOSEN = {
    "turned by 37 degrees": Change(turn=turned(np.deg2rad(37))),
    "100 km from the origin": Change(shift_m=FAR_M),
    "mirrored": Change(turn=np.diag([-1.0, 1.0, 1.0])),
    "another order of markers": Change(columns=(5, 1, 3, 2, 0, 4)),
    "another order of recordings": Change(recordings=-1),
    "a hundredth of the size": Change(length=0.01, time=0.1),  # gravity is the same
    "all at once": Change(
        length=1.7,
        time=np.sqrt(1.7),
        turn=turned(2.0),
        shift_m=np.array([-30.0, 12.0, -0.7]),
        later_s=500.0,
        columns=(4, 2, 5, 0, 1, 3),
        recordings=-1,
    ),
}


@pytest.fixture(scope="module")
def recordings():
    found = []
    for name, seed in (("monday", 5), ("tuesday", 6)):
        one, _ = hd.synthesize("hopper", name=name, seed=seed, **SIMULATED, **CAMERAS)
        kept = [one.markers.index(marker) for marker in (*BODY, *FEET)]
        found.append(
            hd.Recording.from_arrays(
                one.time,
                one.positions[:, kept],
                (*BODY, *FEET),
                feet=FEET,
                body=BODY,
                name=name,
            )
        )
    return found


def numbers(recordings, change=None):
    """Return the numbers of a study that have no unit, or in units of the change."""
    change = change or Change()
    study = hd.study(
        [change.of(one) for one in recordings][:: change.recordings], **QUICK
    )
    effect, sections, units = study.verdict.effect, study.sections, study.units
    table = study.touchdowns.sort_values(["recording", "touchdown"])
    contacts = table[[f"contact_{foot}_s" for foot in FEET]].to_numpy() - change.later_s
    prediction = study.prediction().prediction_summary.set_index("model")
    distances = study.constraint_subspaces().distance_summary.set_index("kind")
    return {
        "residual of the floor": study.floors["monday"].residual_rms_m / change.length,
        "pre section": sections.pre_height_m / change.length,
        "post section": sections.post_height_m / change.length,
        "landings used": float((~table["excluded"]).sum()),
        "contacts": contacts / change.time,
        "length unit": units["length_unit_m"] / change.length,
        "time unit": units["time_unit_s"] / change.time,
        "estimate": effect.estimate,
        "upper bound": effect.upper_bound,
        "p value": effect.p_value,
        "prediction": prediction["median_mse"].to_numpy(),
        "distances": distances["median_distance"].to_numpy(),
    }


@pytest.fixture(scope="module")
def plain(recordings):
    return numbers(recordings)


def differing(one, other):
    """Return the names of the numbers that differ by more than rounding."""
    return {
        name
        for name, value in one.items()
        if not np.allclose(value, other[name], rtol=RELATIVE, atol=0.0, equal_nan=True)
    }


#: Each takes 3 s. What is wrong with one of the others is wrong with all at once.
SOME = [*UNCHOSEN]
if "ALL" not in os.environ:
    SOME = ["100 km from the origin", "mirrored", "all at once"]


@pytest.mark.parametrize("name", SOME)
def test_what_nobody_chose_changes_nothing(recordings, plain, name):
    assert differing(plain, numbers(recordings, UNCHOSEN[name])) == set()


def test_a_change_of_the_data_changes_the_answer(recordings, plain):
    """A tilt of 0.1 degrees is no choice of axes: up is where gravity says."""
    c, s = np.cos(np.deg2rad(0.1)), np.sin(np.deg2rad(0.1))
    tilt = Change(turn=np.array([[1.0, 0.0, 0.0], [0.0, c, s], [0.0, -s, c]]))
    changed = differing(plain, numbers(recordings, tilt))
    # The floor's fit takes most of the tilt out of the heights, but not out of the
    # motion.
    assert {"length unit", "time unit", "estimate", "upper bound"} <= changed
    assert plain["estimate"] > 0.1
    rng = np.random.default_rng(np.random.SeedSequence(1))
    noisier = [
        replace(
            one,
            positions=one.positions + rng.normal(scale=2e-5, size=one.positions.shape),
        )
        for one in recordings
    ]
    assert {"contacts", "estimate", "prediction"} <= differing(plain, numbers(noisier))
