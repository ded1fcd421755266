"""Choices within the printed method: where the text leaves two ways, or has one wrong.

The defaults are corrected; `AS_PRINTED` is the text to the letter.
"""

from __future__ import annotations

from dataclasses import dataclass

from hopdata.hybrid.arguments import expect
from hopdata.hybrid.printed.roots import FINDERS


@dataclass(frozen=True)
class PrintedOptions:
    """Choices within Algorithms 5, 6 and 7.

    Parameters
    ----------
    root_finder : str
        Root of a Hermite spline (Algorithm 6): ``"illinois"``, as section 4.3.3
        recommends, or ``"cubic"``, the closed form that section 4.4.1 says was used.
    refresh_slopes : bool
        Whether the slopes at both ends of the step are evaluated again after each
        crossing. False follows Algorithm 5 to the letter, which sets them once: later
        events of the step are then interpolated with slopes of a mode that has ended.
    keep_locks : bool
        Whether locks are kept from step to step, a guard at zero having the lock that
        its rate leads to. False follows Algorithm 5, which reads them at each step from
        the signs of the event functions: a guard that is exactly zero then has the sign
        0, belongs to no mode, and is never crossed.
    cross_at_surface : bool
        Whether a guard that is not crossed yet, but at or beyond zero at the start of
        what is left of a step, is crossed there. False follows Algorithm 6, whose root
        finder needs a bracket: guards that cross together, where rounding moves one of
        them beyond zero, are an `ArithmeticError`.
    tail : str
        What leads from a crossing to the end of its step: ``"heun"``, one step of
        Heun's third-order method, as in Algorithm 5, whose error nothing bounds but the
        length of the step; or ``"restart"``: the step ends at its first crossing, from
        which the classical solver starts anew, with its own error control.
    boundary : str
        Where one region gives way to the next in Algorithm 7: ``"localised"``, where
        the Hermite spline of the velocity is zero, or ``"mesh"``, as printed: at the
        first mesh point with a velocity of the other sign, so that an apex and a
        touchdown within one step lose the touchdown.
    rest : str
        The sign of a velocity of zero in Algorithm 7: ``"acceleration"``, or
        ``"rising"``, as printed: a body at rest that falls is then taken for one that
        rises, whose region ends after one step.
    end : str
        Until when Algorithm 7 goes on: ``"before"``, while the time is before the end,
        or ``"at"``, as printed: also while it is at the end, so that it never ends. An
        `ArithmeticError` says so.
    """

    root_finder: str = "illinois"
    refresh_slopes: bool = True
    keep_locks: bool = True
    cross_at_surface: bool = True
    tail: str = "heun"
    boundary: str = "localised"
    rest: str = "acceleration"
    end: str = "before"

    def __post_init__(self) -> None:
        for name, choices in CHOICES.items():
            found = getattr(self, name)
            wanted = f"one of {', '.join(choices)}"
            expect(found in choices, name, wanted, found)
        for name in SWITCHES:
            found = getattr(self, name)
            expect(isinstance(found, bool), name, "True or False", found)


# Choices that are made or not.
SWITCHES = ("refresh_slopes", "keep_locks", "cross_at_surface")
# The names that each choice of `PrintedOptions` may have, the default first.
CHOICES: dict[str, tuple[str, ...]] = {
    "root_finder": tuple(FINDERS),
    "tail": ("heun", "restart"),
    "boundary": ("localised", "mesh"),
    "rest": ("acceleration", "rising"),
    "end": ("before", "at"),
}

# The text to the letter, with the root finder of its experiments (section 4.4.1).
AS_PRINTED = PrintedOptions(
    root_finder="cubic",
    refresh_slopes=False,
    keep_locks=False,
    cross_at_surface=False,
    tail="heun",
    boundary="mesh",
    rest="rising",
    end="at",
)
