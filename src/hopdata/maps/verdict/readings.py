"""What the landings say if the errors of the contact instants are not known.

What the inputs do not foretell of the instants may then be posture, which rounds the
kinks, or errors of the instants, which leave them sharp: the expected instants are not
wrong by them. If it is one and is taken for the other, the kinks are too large, or too
small. No share of it can be excluded, so the landings are read both ways, and what is
stated holds under either.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hopdata.maps.verdict.comparison import Comparison
from hopdata.maps.verdict.data import Options
from hopdata.maps.verdict.effect import AtContact, EffectSize
from hopdata.maps.verdict.expected import Unforetold
from hopdata.maps.verdict.growth import Growth
from hopdata.maps.verdict.inputs import SectionLandings
from hopdata.maps.verdict.model import KinkFit
from hopdata.maps.verdict.orders import PairEffect
from hopdata.maps.verdict.sizes import (
    Sizes,
    at_contact,
    has_jump,
    sizes_of,
    with_jump_beside_bends,
    with_kinks_beside_jump,
)
from hopdata.maps.verdict.window import fit_of_best_window

#: Rests below this share of the instants' mean square are posture, whatever they are.
#: Unit: 1. Origin: measured: of simulated kinks of 0.27, errors of this share changed
#: the size by 0.003; errors of 0.004 passed for saturation in two of three studies.
NEGLIGIBLE = 0.002


@dataclass(frozen=True)
class Reading:
    """The landings, their kinks, and the sizes of these.

    Attributes
    ----------
    landings, fit, sizes
        What was fitted to what, and its sizes over the landings.
    contact
        The size at the simultaneous contact.
    parts
        If the rest may be errors of the instants or posture, the readings as the one
        and as the other. `landings` and `fit` are those of the first.
    """

    landings: SectionLandings
    fit: KinkFit
    sizes: Sizes
    contact: AtContact
    parts: "tuple[Reading, ...]" = ()

    def each(self) -> "tuple[Reading, ...]":
        """Return both readings, or the only one."""
        return self.parts or (self,)

    @property
    def surely_saturates(self) -> bool:
        """Whether the kinks saturate in each reading."""
        return all(reading.contact.saturates for reading in self.each())

    def least_time_constant(self, share: float) -> float | None:
        """Return the least time constant of which this share shows in every reading.

        See `Lasting.least_time_constant`.
        """
        longest = 0.0
        for reading in self.each():
            lasting = reading.fit.lasting(reading.landings)
            if lasting is None:
                return None
            found = lasting.least_time_constant(share)
            if found is None:
                return None
            longest = max(longest, found)
        return longest

    def growth(self) -> Growth | None:
        """Return the slopes that the landings allow in any reading: see `growth`."""
        found = [reading.fit.growth(reading.landings) for reading in self.each()]
        slopes = [one for one in found if one is not None]
        if len(slopes) < len(found):
            return None
        return Growth(
            slope=slopes[0].slope,
            low=min(one.low for one in slopes),
            high=max(one.high for one in slopes),
        )


def read(
    landings: SectionLandings,
    comparison: Comparison,
    options: Options,
    *,
    errors_known: bool,
) -> Reading:
    """Return what the landings say.

    Parameters
    ----------
    landings, comparison, options
        What is compared, and how.
    errors_known
        Whether the errors of the contact instants are known. If they are not, and the
        rest is not negligible, the sizes hold for posture and for errors.

    Raises
    ------
    AnalysisError
        As by `fit_of_best_window`.
    """
    of_posture = _reading(landings, comparison, options)
    if errors_known or not rest_matters(landings):
        return of_posture
    rest = landings.unforetold
    none = Unforetold(rest.by_noise, np.zeros_like(rest.by_posture))
    of_errors = _reading(replace(landings, unforetold=none), comparison, options)
    return under_both(of_errors, of_posture)


def rest_matters(landings: SectionLandings) -> bool:
    """Return whether what is not foretold, beside noise of the inputs, rounds kinks."""
    foretold = float(np.trace(np.cov(landings.expected.T)))
    rest = float(np.trace(landings.unforetold.by_posture))
    return rest > NEGLIGIBLE * foretold


def _reading(
    landings: SectionLandings, comparison: Comparison, options: Options
) -> Reading:
    """Return what the landings say if the rest is what they say it is."""
    fit = fit_of_best_window(landings, comparison)
    sizes = sizes_of(fit, landings, comparison, options)
    contact = at_contact(fit, landings, comparison, sizes.effect, options)
    sizes = with_jump_beside_bends(sizes, contact, fit, landings, comparison, options)
    if has_jump(sizes):
        fit = fit.kinks_beside_jumps()
        sizes = with_kinks_beside_jump(sizes, fit, landings, comparison, options)
        contact = at_contact(fit, landings, comparison, sizes.effect, options)
    return Reading(landings, fit, sizes, contact)


def under_both(one: Reading, other: Reading) -> Reading:
    """Return a reading whose intervals and bounds hold under both."""
    contact = AtContact(
        size=size_under_both(one.contact.size, other.contact.size),
        saturates=one.contact.saturates or other.contact.saturates,
        p_value=min(one.contact.p_value, other.contact.p_value),
    )
    jump = None
    if one.sizes.jump is not None and other.sizes.jump is not None:
        jump = size_under_both(one.sizes.jump, other.sizes.jump)
    alone = ""
    if one.sizes.alone == other.sizes.alone:
        alone = one.sizes.alone
    sizes = Sizes(
        effect=size_under_both(one.sizes.effect, other.sizes.effect),
        jump=jump,
        alike=one.sizes.alike or other.sizes.alike,
        levels=one.sizes.levels,
        orders=_pairs_under_both(one.sizes.orders, other.sizes.orders),
        alone=alone,
        jump_unsure=one.sizes.jump_unsure or other.sizes.jump_unsure,
        jump_or_bend=one.sizes.jump_or_bend or other.sizes.jump_or_bend,
    )
    return replace(one, contact=contact, sizes=sizes, parts=(one, other))


def size_under_both(one: EffectSize, other: EffectSize) -> EffectSize:
    """Return the size of `one`, with an interval and bounds that hold under both."""
    worse = max(one, other, key=lambda size: size.detectable)
    return replace(
        one,
        low=min(one.low, other.low),
        high=max(one.high, other.high),
        upper_bound=max(one.upper_bound, other.upper_bound),
        detectable=worse.detectable,
        p_value=max(one.p_value, other.p_value),
        allowed=worse.allowed,
        left=max(one.left, other.left),
        detectable_nearest=worse.detectable_nearest,
        allowed_nearest=worse.allowed_nearest,
    )


def _pairs_under_both(
    ones: Sequence[PairEffect], others: Sequence[PairEffect]
) -> list[PairEffect]:
    """Return the pairs that both have, with intervals that hold under both."""
    by_name = {(pair.of, pair.first, pair.second): pair for pair in others}
    found = []
    for one in ones:
        other = by_name.get((one.of, one.first, one.second))
        if other is None:
            continue
        both = replace(
            one,
            low=min(one.low, other.low),
            high=max(one.high, other.high),
            p_value=max(one.p_value, other.p_value),
            allowed=max(one.allowed, other.allowed),
        )
        found.append(both)
    return found
