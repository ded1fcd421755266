"""A process over its inputs as a table: what Figure 3.3 shows."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hopdata.blas import one_blas_thread
from hopdata.errors import AnalysisError
from hopdata.steering.models.learning import IN_UNITS
from hopdata.steering.models.process import TURN, FrameChangeProcess

if TYPE_CHECKING:
    import pandas as pd

FloatArray = NDArray[np.float64]

COLUMNS = ("dx_mm", "dy_mm", "dtheta_deg")
CELLS_PER_TURN = 48


@one_blas_thread()
def map_table(
    process: FrameChangeProcess, swing_limit_rad: float, *, swings: int = 33
) -> pd.DataFrame:
    """Tabulate mean and standard deviation over three turns of the boom and all swings.

    Angles are not brought back into one turn, so that a process that is not periodic shows it.

    Parameters
    ----------
    process : FrameChangeProcess
        Without history.
    swing_limit_rad : float
        Swings go from minus to plus this.
    swings : int
        Number of swings.

    Returns
    -------
    DataFrame
        Columns ``boom_angle_rad`` (from -2 pi to 4 pi), ``swing_rad``, the mean ``dx_mm, dy_mm,
        dtheta_deg`` and the same with ``_sd``: standard deviation of the mean, without noise.

    Raises
    ------
    AnalysisError
        If the process has history.
    """
    import pandas as pd

    if process.n_inputs != 2:
        raise AnalysisError(
            f"map: expected a process of boom angle and swing, found one of {process.n_inputs} "
            "inputs"
        )
    angle = np.linspace(-TURN, 2 * TURN, 3 * CELLS_PER_TURN + 1)
    swing = np.linspace(-swing_limit_rad, swing_limit_rad, swings)
    points = np.stack(np.meshgrid(angle, swing, indexing="ij"), axis=-1).reshape(-1, 2)
    table = pd.DataFrame(points, columns=["boom_angle_rad", "swing_rad"])
    table[list(COLUMNS)] = process.mean_at(points) * IN_UNITS
    table[[f"{name}_sd" for name in COLUMNS]] = process.sd_at(points) * IN_UNITS
    return table


def training_table(process: FrameChangeProcess) -> pd.DataFrame:
    """Return the training hops of a process, each once: inputs and outputs as in `map_table`."""
    import pandas as pd

    angle = process.inputs[:, 0]
    once = (angle >= 0) & (angle < TURN)
    table = pd.DataFrame(process.inputs[once, :2], columns=["boom_angle_rad", "swing_rad"])
    table[list(COLUMNS)] = process.outputs[once] * IN_UNITS
    return table
