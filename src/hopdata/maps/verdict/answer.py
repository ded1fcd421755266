"""The form of a verdict: its numbers, and the one sentence that they amount to."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, fields
from typing import TYPE_CHECKING, Any

import numpy as np

from hopdata.errors import require_choice
from hopdata.maps.verdict.effect import EffectSize
from hopdata.maps.verdict.estimate import CURVATURE_SHARE
from hopdata.maps.verdict.significance import KinkTest

if TYPE_CHECKING:
    import pandas as pd

DIFFERENT, NO_DIFFERENCE, CANNOT_TELL = CONCLUSIONS = ("different", "no difference", "cannot tell")


@dataclass(frozen=True)
class WindowResult:
    """Difference of the maps in one window of contact spread.

    Attributes
    ----------
    window, landings, degree
        Share and number of the landings, and order of the free smooth terms.
    mean_spread_ms, largest_spread_ms
        Contact spread expected for these landings.
    curvature_share
        Share of unmodelled curvature in the variance of the kinks.
    kinks, kinks_low, kinks_high
        Relative difference of the derivatives at zero spread, with its interval.
    chosen
        Whether the verdict rests on this window.
    """

    window: float
    landings: int
    degree: int
    mean_spread_ms: float
    largest_spread_ms: float
    curvature_share: float
    kinks: float
    kinks_low: float
    kinks_high: float
    chosen: bool


@dataclass(frozen=True)
class Verdict:
    """Answer of a study.

    Attributes
    ----------
    conclusion
        ``"different"``, ``"no difference"`` (larger than the margin) or ``"cannot tell"``.
    sentence
        The same in one sentence, with its numbers.
    n_landings, n_schedules
        Landings and schedules that it rests on.
    confidence, margin, power
        Of the interval, the difference that the study wants to exclude, and the power with which
        the detectable one would have been found.
    effect, test
        Size and significance of the kinks in the chosen window; None if there is no answer.
    windows
        The same estimate in every window.
    notes
        What limits the answer, each ``{"what": ..., "reason": ...}``.
    curvature_limit
        Share of curvature in the variance up to which a window is taken.
    """

    conclusion: str
    sentence: str
    n_landings: int
    n_schedules: int
    confidence: float
    margin: float
    power: float
    effect: EffectSize | None = None
    test: KinkTest | None = None
    windows: tuple[WindowResult, ...] = ()
    notes: list[dict[str, str]] = field(default_factory=list)
    curvature_limit: float = CURVATURE_SHARE

    def to_dict(self) -> dict[str, Any]:
        """Return all values, for ``verdict.json``; what is not a number is None."""
        content = asdict(self)
        content["windows"] = [asdict(row) for row in self.windows]
        finite: dict[str, Any] = _finite(content)
        return finite

    def windows_table(self) -> pd.DataFrame:
        """Return the windows as a table, one row each."""
        import pandas as pd

        columns = [one.name for one in fields(WindowResult)]
        return pd.DataFrame([asdict(row) for row in self.windows], columns=columns)


def conclude(test: KinkTest, effect: EffectSize, level: float, margin: float) -> str:
    """Return the conclusion from the test and the one-sided bound of the effect."""
    if test.p_value < level:
        return DIFFERENT
    return NO_DIFFERENCE if effect.upper_bound <= margin else CANNOT_TELL


def sentence(
    conclusion: str, effect: EffectSize, test: KinkTest, confidence: float, margin: float
) -> str:
    """Say a conclusion in one sentence."""
    require_choice("conclusion", conclusion, CONCLUSIONS)
    sure = f"{100 * confidence:g} %"
    if conclusion == DIFFERENT:
        return (
            f"The maps of different contact orders are different: by {effect.estimate:.2g} of the "
            f"map ({sure} interval {effect.low:.2g} to {effect.high:.2g}, {test.p_text})."
        )
    if conclusion == NO_DIFFERENCE:
        return (
            f"No difference between the maps of different contact orders larger than "
            f"{effect.upper_bound:.2g} of the map, at {sure} confidence ({test.p_text})."
        )
    return (
        f"These data cannot tell: no difference was found ({test.p_text}), but one of up "
        f"to {effect.upper_bound:.2g} of the map cannot be excluded, and {margin:g} was wanted."
    )


def _finite(value: Any) -> Any:
    """Return a nested structure with None for every number that JSON cannot hold."""
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value
