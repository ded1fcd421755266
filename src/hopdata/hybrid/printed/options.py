"""What may be chosen in the printed method."""

from __future__ import annotations

from dataclasses import dataclass

ROOT_FINDERS = ("illinois", "cubic")


@dataclass(frozen=True)
class PrintedOptions:
    """Choices within Algorithms 5 and 6.

    Parameters
    ----------
    root_finder : str
        Root of a Hermite spline: ``"illinois"``, as section 4.3.3 recommends, or ``"cubic"``, the
        closed form that section 4.4.1 says was used.
    refresh_slopes : bool
        Whether the slopes at both ends of the step are evaluated again after each crossing.
        False is Algorithm 5 to the letter, which sets them once: the state at every later event
        of the step is then interpolated with slopes of a mode that has ended. For the record only.
    """

    root_finder: str = "illinois"
    refresh_slopes: bool = True

    def __post_init__(self) -> None:
        if self.root_finder not in ROOT_FINDERS:
            raise ValueError(
                f"root_finder: expected one of {', '.join(ROOT_FINDERS)}, found {self.root_finder}"
            )
