"""The Poincare sections of a study, and the heights of feet that they rest on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from hopdata.arrays import Shown
from hopdata.errors import chosen
from hopdata.landings.sections.frames import Frames, Heights, pool_frames
from hopdata.landings.sections.modes import GroundMode

# Whether only frames of landings count.
FRAMES = {"all": False, "landings": True}


@dataclass(frozen=True, repr=False)
class Sections(Shown):
    """Thresholds of foot height, and the two sections.

    Parameters
    ----------
    pre_height_m, post_height_m : float
        Mean height of the body markers at the pre- and post-touchdown section, m.
    min_foot_threshold_m, max_foot_threshold_m : float
        Height of the lowest (highest) foot above which all feet (some feet) are up, m.
    ground_m : float
        Ground mode of the pooled heights of all feet, m.
    min_foot_mode, max_foot_mode : GroundMode
        Ground mode of the lowest and of the highest foot.
    rule : {"landings", "printed"}
        How the sections were chosen.
    bandwidth_m : float or None
        Bandwidth of the densities by which they were chosen, m; None if both heights
        were given.
    threshold_sigmas : float
        Deviations from a mode to its upper knee, with the rule ``"landings"``.
    frames : {"all", "landings"}
        Frames whose body heights are pooled.
    chosen_by : dict
        ``"data"`` or ``"config"`` for each of the four heights above.
    landing_shares : dict
        Share of the landings of all feet that the ``"pre"`` and the ``"post"`` section
        hold; None if there are no landings.
    pre_speed_m_s, post_speed_m_s : float or None
        Median speed of the fall as a landing passes the section, m/s. An error in
        height shifts the instant of the passage by that error over this speed.
    instant_shift_s_m : dict
        For the ``"pre"`` and the ``"post"`` section, how much an error in height shifts
        the instant of the passage, s/m: ``usual``, the median over the landings, and
        ``large``, their 95 % quantile. None where the body hardly falls, and without
        landings.
    depth : dict
        How the rule ``"landings"`` chose among the post sections that hold nearly as
        many landings: ``shallowest_m`` and ``deepest_m``, and what `Depth` has (see
        `hopdata.landings.sections.depth`). Empty if nothing was chosen.
    n_landings : int
        Number of landings of all feet.
    n_frames : int
        Number of frames in which all feet and the body are seen.
    n_used : int
        Number of these frames that are pooled.
    other_rule : dict
        The same recordings by the other rule: ``rule``, ``pre_height_m`` and
        ``post_height_m``; if it has no heights, ``note`` says why. Empty if it was not
        asked for.
    """

    pre_height_m: float
    post_height_m: float
    min_foot_threshold_m: float
    max_foot_threshold_m: float
    ground_m: float
    min_foot_mode: GroundMode
    max_foot_mode: GroundMode
    rule: str
    bandwidth_m: float | None
    threshold_sigmas: float
    frames: str
    chosen_by: dict[str, str]
    landing_shares: dict[str, float | None]
    pre_speed_m_s: float | None
    post_speed_m_s: float | None
    instant_shift_s_m: dict[str, dict[str, float | None]]
    depth: dict[str, Any]
    n_landings: int
    n_frames: int
    n_used: int
    other_rule: dict[str, Any]

    def pooled(self, heights: Sequence[Heights]) -> Frames:
        """Pool the frames whose body heights count, each with its state."""
        return pool_frames(
            heights,
            min_foot_m=self.min_foot_threshold_m,
            max_foot_m=self.max_foot_threshold_m,
            ground_m=self.ground_m,
            landings_only=chosen("sections.frames", self.frames, FRAMES),
        )

    def _told(self) -> str:
        """Describe the heights of the two sections."""
        pre_mm, post_mm = 1e3 * self.pre_height_m, 1e3 * self.post_height_m
        return f"{pre_mm:.1f} mm before, {post_mm:.1f} mm after the landing"

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as plain numbers, strings and dictionaries, for JSON."""
        return asdict(self)

    @classmethod
    def from_dict(cls, fields: Mapping[str, Any]) -> Sections:
        """Make the sections from the fields that `to_dict` returns."""
        made = dict(fields)
        for name in ("min_foot_mode", "max_foot_mode"):
            made[name] = GroundMode(**fields[name])
        return cls(**made)
