"""How the processes are set up: the printed way, the recommended one, and others between them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hopdata.errors import ConfigError, chosen, require_choice
from hopdata.steering.frame_changes import FrameChanges
from hopdata.steering.models.kernels import kernel_code

FloatArray = NDArray[np.float64]

# What of the hop before are inputs: columns of `FrameChanges`.
HISTORIES: dict[str, tuple[str, ...]] = {
    "none": (),
    "swing": ("previous_swing_rad",),
    "change": ("previous_change",),
    "swing and change": ("previous_swing_rad", "previous_change"),
}


@dataclass(frozen=True, kw_only=True)
class ProcessOptions:
    """Options of the three Gaussian processes.

    Parameters
    ----------
    smoothness : float
        Of the Matern kernel, 0.5, 1.5 or 2.5, or infinity for the Gaussian one.
    periodic : bool
        Compare boom angles by points on the circle. Otherwise the training set is copied a turn
        before and a turn after, as printed.
    history : {"none", "swing", "change", "swing and change"}
        What of the hop before are inputs beside boom angle and swing.
    standardised : bool
        Centre each component of the frame change and divide it by its standard deviation, and
        divide the inputs but the boom angle by theirs. Otherwise frame changes are modelled as they
        are, about zero.
    length_unit_m : float
        Unit of length in which they are modelled if not standardised, m; turns are in rad.
    own_scales : bool
        A length scale for each input. Otherwise one for all.
    variance : float, optional
        Variance of the process, in squared units of the output; fitted if not given.
    noise : float, optional
        Variance of the white noise, likewise.
    length_scale : float, optional
        Length scale of all inputs, in rad or, if standardised, their units; fitted if not given.
    restarts : int
        Further random starts of the search for hyper-parameters.
    """

    smoothness: float = 1.5
    periodic: bool = True
    history: str = "none"
    standardised: bool = True
    length_unit_m: float = 1e-3
    own_scales: bool = True
    variance: float | None = None
    noise: float | None = None
    length_scale: float | None = None
    restarts: int = 1

    def __post_init__(self) -> None:
        kernel_code(self.smoothness)
        require_choice("history", self.history, HISTORIES)
        for name in ("variance", "noise", "length_scale", "length_unit_m"):
            value = getattr(self, name)
            if value is not None and not value > 0:
                raise ConfigError(f"{name}: expected more than 0, found {value}")


RECOMMENDED = ProcessOptions()
WITH_PREVIOUS_SWING = ProcessOptions(history="swing")
WITH_PREVIOUS_CHANGE = ProcessOptions(history="change")

# The formula of Section 3.4.2 has no variance and no length scale, so both are 1; motion capture
# gives mm.
PRINTED = ProcessOptions(
    periodic=False,
    standardised=False,
    own_scales=False,
    variance=1.0,
    noise=0.1,
    length_scale=1.0,
    restarts=0,
)


def process_inputs(changes: FrameChanges, history: str) -> FloatArray:
    """Return the inputs (n, d): boom angle, swing, and what `history` adds; NaN where unknown."""
    added = [getattr(changes, name) for name in chosen("history", history, HISTORIES)]
    return np.column_stack([changes.boom_angle_rad, changes.swing_rad, *added])
