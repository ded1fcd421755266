"""Which landings a study is judged by: those nearest to the simultaneous contact.

Kinks show most where contacts lie far apart, and so does what smooth terms leave. With
few landings noise is what limits a study, and it needs them all; with many it is what
smooth terms leave, and those of the largest spread are left out. The study takes the
window in which it can see the smallest difference: what is allowed for, which grows
with the spread, and beyond it the noise of the size.
"""

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.maps.verdict.effect import Comparison, squared_size
from hopdata.maps.verdict.inputs import SectionLandings
from hopdata.maps.verdict.model import LEFT, KinkFit, fit_kinks, left_by_window

#: Wider windows that are tried.
#: Unit: share of the landings. Origin: chosen: half of the landings beyond `WINDOW`,
#: and all.
WIDER = (0.925, 1.0)

#: Standard errors beyond what is allowed at which a difference is found.
#: Unit: 1. Origin: derived: 1.64 for a test of 5 %, and 0.84 to find four of five.
FOUND_AT = 2.5


def fit_of_best_window(
    landings: SectionLandings, comparison: Comparison
) -> tuple[KinkFit, FloatArray]:
    """Return the kinks in the window that shows the smallest difference.

    The second value is the root of their squared size: see `squared_size`.

    Raises
    ------
    AnalysisError
        As by `fit_kinks`.
    """
    fit = fit_kinks(landings)
    root = squared_size(fit, landings, comparison)
    least = fit.allowed + FOUND_AT * _noise(fit, root)
    for share in WIDER:
        left = LEFT * left_by_window(landings.expected, share)
        if left >= least:
            # Not even a size without noise could be seen better.
            break
        wide = fit_kinks(landings, share)
        wide_root = squared_size(wide, landings, comparison)
        seen_from = wide.allowed + FOUND_AT * _noise(wide, wide_root)
        if seen_from < least:
            fit = wide
            root = wide_root
            least = seen_from
    return fit, root


def _noise(fit: KinkFit, root: FloatArray) -> float:
    """Return the standard error of the size in the direction where it is largest."""
    return float(np.linalg.norm(fit.null_scores @ root.T, 2))
