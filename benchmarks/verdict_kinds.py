"""The kinds of studies on which the verdict is judged: bodies, controls, observations."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np
from scipy.signal import butter, sosfiltfilt

from hopdata.scenes.hopper_parameters import HopperParameters
from hopdata.scenes.quadruped import Quadruped
from hopdata.scenes.scene import Control, Scene
from hopdata.synthesis.landings import (
    SectionHeights,
)
from hopdata.synthesis.trial import Kicks, MarkerOptions

# Landings of a study.
WHOLE = 2100

# Numbers from which hoppers of other shapes are drawn.
BODIES = range(9500, 9532)

HOPPER_SECTIONS = SectionHeights(0.502, 0.2774, np.array(MarkerOptions().body_m))
FOUR_MARKERS = [
    [0.2, 0.03, 0.05],
    [-0.05, 0.12, 0.075],
    [-0.2, -0.07, 0.055],
    [0.06, -0.1, 0.09],
]
QUADRUPED_SECTIONS = SectionHeights(0.511, 0.2935, np.array(FOUR_MARKERS))
TWO = HopperParameters(n_legs=2)
STIFF_TWO = HopperParameters(
    n_legs=2, stiffness_n_m=135.0, damping_n_s_m=7.2, preload_n=33.0
)
SIX = HopperParameters(n_legs=6, stiffness_n_m=45.0, damping_n_s_m=2.4, preload_n=11.0)


@dataclass(frozen=True)
class Kind:
    """A body with its disturbances and control, and how it is observed."""

    scene: Scene = field(default_factory=HopperParameters)
    sections: SectionHeights | None = field(
        default=HOPPER_SECTIONS
    )  # None: found from its gait
    kicks: Kicks = field(default_factory=Kicks)
    control: Control = field(default_factory=Control)
    noise_m: float = 0.0006
    rate_hz: float = 100.0
    hops: int = WHOLE
    spoil: Callable[[np.ndarray, np.random.Generator, float], np.ndarray] | None = None
    relabel: Callable[[np.ndarray, np.random.Generator], np.ndarray] | None = None
    thinned: bool = False
    moves_as: str = ""  # the kind with the same true motions, observed in another way
    led_by: Scene | None = (
        None  # a body that supplies the apexes, if this one falls over
    )

    @property
    def strength(self) -> float:
        """The one strength that is not zero, or zero; a delay in ms."""
        return (
            self.control.coupling or self.control.impulse or 1e3 * self.control.delay_s
        )


def low_passed(
    tracks: np.ndarray, _rng: np.random.Generator, rate_hz: float
) -> np.ndarray:
    """Filter as gait laboratories do: Butterworth, 20 Hz, forward and backward."""
    sos = butter(2, 20.0, fs=rate_hz, output="sos")
    whole = np.isfinite(tracks).all(axis=(0, 2, 3))
    tracks = tracks.copy()
    tracks[:, whole] = sosfiltfilt(sos, tracks[:, whole], axis=1)
    return tracks


def drifted(
    tracks: np.ndarray, _rng: np.random.Generator, _rate_hz: float
) -> np.ndarray:
    """Let the cameras' height drift by 4 mm, once up and down over the study."""
    phase = 2 * np.pi * np.arange(len(tracks)) / len(tracks)
    return tracks + 0.004 * np.sin(phase)[:, None, None, None] * np.array(
        [0.0, 0.0, 1.0]
    )


def correlated(
    tracks: np.ndarray, rng: np.random.Generator, _rate_hz: float
) -> np.ndarray:
    """Add noise of 0.6 mm with a correlation of 0.6 from frame to frame."""
    steps = rng.standard_normal(tracks.shape)
    for frame in range(1, tracks.shape[1]):
        steps[:, frame] = 0.6 * steps[:, frame - 1] + 0.8 * steps[:, frame]
    return tracks + 0.0006 * steps


def heavy_tailed(
    tracks: np.ndarray, rng: np.random.Generator, _rate_hz: float
) -> np.ndarray:
    """Add noise of 0.6 mm from Student's t distribution with three degrees of freedom."""
    return tracks + 0.0006 / np.sqrt(3) * rng.standard_t(3, tracks.shape)


def swapped(instants: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Exchange the labels of two feet in 3 % of the landings."""
    rows = np.flatnonzero(rng.random(len(instants)) < 0.03)
    instants = instants.copy()
    instants[rows, :2] = instants[rows, 1::-1]
    return instants


def other_body(number: int) -> HopperParameters:
    """Draw a hopper of another shape: feet, mass, size, inertia, legs and height of its hops."""
    draw = np.random.default_rng([78, number])
    legs, mass = int(draw.integers(3, 5)), draw.uniform(1.8, 4.6)
    share = mass / 2.3 * 3 / legs  # scales the legs to carry this body
    inertia = 0.08 * mass / 2.3 * draw.uniform(0.4, 1.1)
    stiffness, extension = (
        90.0 * share * draw.uniform(0.7, 1.2),
        draw.uniform(0.105, 0.13),
    )
    weight = (mass + HopperParameters().counterweight_mass_kg) * 9.81 / legs
    return HopperParameters(
        n_legs=legs, mass_kg=mass, foot_radius_m=draw.uniform(0.3, 0.5),
        leg_length_m=draw.uniform(0.22, 0.36), stiffness_n_m=stiffness,
        damping_n_s_m=4.8 * share * draw.uniform(0.8, 1.2), release_extension_m=extension,
        preload_n=stiffness * extension + weight * draw.uniform(1.2, 1.4),
        inertia_x_kg_m2=inertia, inertia_y_kg_m2=inertia, inertia_z_kg_m2=1.4 * inertia,
    )  # fmt: skip


def kinds() -> dict[str, Kind]:
    """Return all kinds by name; those that begin with C1 have no difference."""
    hopper, kicks, seen = HopperParameters(), Kicks(), Kind(moves_as="C1")
    larger = replace(kicks, angular_velocity_rad_s=0.35)
    quadruped = Kind(scene=Quadruped(), sections=QUADRUPED_SECTIONS)
    same = {
        "C1": Kind(),
        "C1 twice the noise": replace(seen, noise_m=0.0012),
        "C1 low-passed": replace(seen, spoil=low_passed),
        "C1 drifting": replace(seen, spoil=drifted),
        "C1 correlated noise": replace(seen, noise_m=0.0, spoil=correlated),
        "C1 heavy tails": replace(seen, noise_m=0.0, spoil=heavy_tailed),
        "C1 swapped labels": replace(seen, relabel=swapped),
        "C1 a rare class": replace(seen, thinned=True),
        "C1 at 60 Hz": Kind(rate_hz=60.0),
        "C1 at 250 Hz": Kind(rate_hz=250.0),
        "C1 softer legs": Kind(
            scene=replace(hopper, stiffness_n_m=60.0, preload_n=19.0)
        ),
        "C1 stiffer legs": Kind(
            scene=replace(hopper, stiffness_n_m=120.0, preload_n=25.0)
        ),
        "C1 larger kicks": Kind(kicks=larger),
        "C1 uneven preloads": Kind(kicks=replace(kicks, preload_fraction=0.1)),
        "C1 quadruped": quadruped,
        "C1 two feet": Kind(scene=TWO, led_by=hopper),
        "C1 two feet larger kicks": Kind(scene=TWO, led_by=hopper, kicks=larger),
        "C1 two stiff feet": Kind(
            scene=STIFF_TWO, led_by=hopper
        ),  # the feet of config/biped.yaml
        "C1 six feet": Kind(scene=SIX),
    }
    controls = {f"kappa {k:g}": Control(coupling=k) for k in (0.1, 0.2, 0.4)}
    controls |= {f"eps {e:g}": Control(impulse=e) for e in (0.1, 0.2, 0.3)}
    controls |= {f"tau {1e3 * t:g} ms": Control(delay_s=t) for t in (0.005, 0.01)}
    coupled = {
        f"quadruped kappa {k:g}": replace(quadruped, control=Control(coupling=k))
        for k in (0.1, 0.2)
    }
    of_feet = "two feet", "two feet larger kicks", "two stiff feet", "six feet"
    coupled |= {
        f"{name} kappa {k:g}": replace(same[f"C1 {name}"], control=Control(coupling=k))
        for name, k in [*product(of_feet[:-1], (0.1, 0.3)), (of_feet[-1], 0.1)]
    }
    bodies = {f"body {n}": Kind(scene=other_body(n), sections=None) for n in BODIES}
    same |= {f"C1 {name}": kind for name, kind in bodies.items()}
    coupled |= {
        f"{name} kappa 0.3": replace(kind, control=Control(coupling=0.3))
        for name, kind in bodies.items()
    }
    weakest = {"kappa 0.05": Kind(control=Control(coupling=0.05), hops=2860)}
    controlled = {name: Kind(control=control) for name, control in controls.items()}
    return same | weakest | controlled | coupled
