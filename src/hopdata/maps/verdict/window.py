"""Which landings a study is judged by: those nearest to the simultaneous contact.

Kinks show most where contacts lie far apart, and so does what smooth terms leave. With
few landings noise is what limits a study, and it needs them all; with many it is what
smooth terms leave, and those of the largest spread are left out. The study takes the
window in which it can see the smallest difference: what is allowed for, which grows
with the spread, and beyond it the noise of the size.
"""

from dataclasses import replace

import numpy as np

from hopdata.maps.verdict.comparison import Comparison, squared_size
from hopdata.maps.verdict.inputs import SectionLandings
from hopdata.maps.verdict.model import (
    LEFT,
    KinkFit,
    Nearest,
    fit_kinks,
    left_by_window,
)

#: Wider windows that are tried.
#: Unit: share of the landings. Origin: chosen: half of the landings beyond `WINDOW`,
#: and all.
WIDER = (0.925, 1.0)

#: Standard errors beyond what is allowed at which a difference is found.
#: Unit: 1. Origin: derived: 1.64 for a test of 5 %, and 0.84 to find four of five.
FOUND_AT = 2.5


def fit_of_best_window(landings: SectionLandings, comparison: Comparison) -> KinkFit:
    """Return the kinks in the window that shows the smallest difference.

    Beside those of a wider window it is kept what the nearest landings leave, since a
    larger study of the same body will be judged by these.

    Raises
    ------
    AnalysisError
        As by `fit_kinks`.
    """
    nearest = fit_kinks(landings)
    noise_of_nearest = _noise(nearest, landings, comparison)
    best = nearest
    least = _seen_from(nearest, noise_of_nearest)
    for share in WIDER:
        left = LEFT * left_by_window(landings.expected, share)
        if left >= least:
            # Not even a size without noise could be seen better.
            break
        wide = fit_kinks(landings, share)
        noise = _noise(wide, landings, comparison)
        seen_from = _seen_from(wide, noise)
        if seen_from < least:
            of_nearest = Nearest(
                nearest.allowed,
                noise_of_nearest / noise,
                nearest.faded,
                nearest.third_is_sure,
            )
            best = replace(wide, nearest=of_nearest)
            least = seen_from
    return best


def _noise(fit: KinkFit, landings: SectionLandings, comparison: Comparison) -> float:
    """Return the noise of the size in the direction where it is largest."""
    root = squared_size(fit, landings, comparison)
    return float(np.linalg.norm(fit.null_scores @ root.T, 2))


def _seen_from(fit: KinkFit, noise: float) -> float:
    """Return the size from which on a difference can be seen, roughly."""
    return fit.allowed + FOUND_AT * noise
