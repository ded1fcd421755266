"""The sizes of a study: of kinks, jumps and each pair, from the same random signs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

from hopdata.maps.draws import named_generator
from hopdata.maps.verdict import comparison as comparing
from hopdata.maps.verdict import effect as sizing
from hopdata.maps.verdict import orders as which
from hopdata.maps.verdict.comparison import Comparison
from hopdata.maps.verdict.data import Options
from hopdata.maps.verdict.effect import AtContact, EffectSize
from hopdata.maps.verdict.inputs import SectionLandings
from hopdata.maps.verdict.model import KinkFit, err_alike
from hopdata.maps.verdict.own_maps import own_maps
from hopdata.maps.verdict.saturation import LEVEL
from hopdata.maps.verdict.signs import Draws, level_of, signed_errors

_Size = TypeVar("_Size", EffectSize, which.PairEffect)


@dataclass(frozen=True)
class Sizes:
    """The sizes of a study, the levels of their tests, and the size of each pair.

    `orders` has the pairs, then each order against all others; `alone` is the order
    that alone differs, or empty. A jump that was found may be a bend, too: if
    `jump_unsure`, none is stated; if `jump_or_bend`, it is.
    """

    effect: EffectSize
    jump: EffectSize | None
    alike: bool
    levels: dict[str, float]
    orders: list[which.PairEffect]
    alone: str
    jump_unsure: bool = False
    jump_or_bend: bool = False


def sizes_of(
    fit: KinkFit,
    landings: SectionLandings,
    comparison: Comparison,
    options: Options,
) -> Sizes:
    """Return the sizes of kinks and jumps, and of each pair, from the same signs."""
    fits = [fit]
    roots = [comparing.squared_size(fit, landings, comparison)]
    if fit.jumps is not None:
        fits.append(fit.jumps)
        roots.append(comparing.squared_jump(fit, landings, comparison))
    alike = any(
        err_alike(part.scores @ root.T) for part, root in zip(fits, roots, strict=True)
    )
    generator = named_generator(options.seed, "verdict", "signs")
    errors = signed_errors(fits, options.flips, generator, alike=alike)
    draws = [
        Draws(part, root, signed, alike=alike)
        for part, root, signed in zip(fits, roots, errors, strict=True)
    ]
    shares = [1.0]
    if fit.jumps is not None:
        shares = [1.0 - which.OF_JUMPS, which.OF_JUMPS]
    tests = [
        which.OneTest(drawn, part.allowed, share)
        for drawn, part, share in zip(draws, fits, shares, strict=True)
    ]
    joint = which.joint_level(tests, level_of(options.confidence))
    effects = [
        sizing.size_drawn(
            drawn,
            part,
            level_found=level,
            confidence=options.confidence,
            power=options.power,
        )
        for drawn, part, level in zip(draws, fits, joint.of_each, strict=True)
    ]
    pairs = which.pairs_of_maps(fit, errors[0], landings, comparison)
    jump = None
    if fit.jumps is not None:
        jump = effects[1]
        pairs += which.pairs_of_jumps(fit, errors[1], landings, comparison)
    of_pairs = which.pair_effects(
        pairs, alike=alike, joint_p_value=joint.p_value, confidence=options.confidence
    )
    levels = dict(zip(("effect", "jump"), joint.of_each, strict=False))
    own = own_maps(fit, landings, comparison, options, alike=alike)
    every = [*of_pairs, *own.effects]
    return Sizes(effects[0], jump, alike, levels, every, own.alone)


def with_jump_beside_bends(
    sizes: Sizes,
    contact: AtContact,
    fit: KinkFit,
    landings: SectionLandings,
    comparison: Comparison,
    options: Options,
) -> Sizes:
    """Return the sizes with what is left of a jump beside bends.

    Where the random signs show that kinks saturate, a jump has to stand beside bends of
    each time constant, too. If it does not, the low ends of all jumps are zero, and no
    p-value is below that of the jump beside the bends. If kinks are found to saturate,
    part of what looked like the jump is theirs: its size is that beside the likeliest
    bends, in an interval that holds those beside all.

    Where they do not show it, a jump that does not stand may still be one: bends take
    most of the power to find it (of 20 jumps of bodies near the smallest that can be
    found, 6 do not stand).
    """
    jump = sizes.jump
    if jump is None:
        return sizes
    if not has_jump(sizes):
        return sizes
    beside = _jumps_beside_bends(fit, landings, comparison, options, sizes.levels)
    size = _widest([one.size for one in beside])
    of_pairs = zip(*(one.pairs for one in beside), strict=True)
    pairs = [_widest(of_pair) for of_pair in of_pairs]
    stands = size.low > 0.0 or any(_is_jump_found(pair) for pair in pairs)
    if contact.p_value >= LEVEL:
        return replace(sizes, jump_or_bend=not stands)
    if not stands:
        return _without_jump(sizes, jump, size.p_value)
    if not contact.saturates:
        return sizes
    bound = max(one.size.upper_bound for one in beside)
    orders = []
    for pair in sizes.orders:
        told = pair
        if pair.of == which.OF_JUMP:
            told = pairs.pop(0)
        orders.append(told)
    return replace(sizes, jump=replace(size, upper_bound=bound), orders=orders)


def has_jump(sizes: Sizes) -> bool:
    """Return whether a jump is found, of all exchanges together or of one."""
    if sizes.jump is not None and sizes.jump.low > 0.0:
        return True
    return any(_is_jump_found(pair) for pair in sizes.orders)


def with_kinks_beside_jump(
    sizes: Sizes,
    fit: KinkFit,
    landings: SectionLandings,
    comparison: Comparison,
    options: Options,
) -> Sizes:
    """Return the sizes with those of the kinks beside a jump that was found.

    `fit` has the kinks beside the steps. The jump and its pairs stay as they are.
    """
    beside = sizes_of(fit, landings, comparison, options)
    maps = [pair for pair in beside.orders if pair.of == which.OF_MAP]
    jumps = [pair for pair in sizes.orders if pair.of == which.OF_JUMP]
    own = [pair for pair in beside.orders if pair.of == which.OF_ORDER]
    return replace(
        sizes,
        effect=beside.effect,
        levels={**sizes.levels, "effect": beside.levels["effect"]},
        orders=[*maps, *jumps, *own],
        alone=beside.alone,
    )


def _without_jump(sizes: Sizes, jump: EffectSize, p_value: float) -> Sizes:
    """Return the sizes with jumps that have no low end, and no smaller p-value."""
    orders = []
    for pair in sizes.orders:
        told = pair
        if pair.of == which.OF_JUMP:
            told = replace(pair, low=0.0, p_value=max(pair.p_value, p_value))
        orders.append(told)
    unsure = replace(jump, low=0.0, p_value=max(jump.p_value, p_value))
    return replace(sizes, jump=unsure, orders=orders, jump_unsure=True)


def _is_jump_found(pair: which.PairEffect) -> bool:
    return pair.of == which.OF_JUMP and pair.low > 0.0


def _widest(sizes: Sequence[_Size]) -> _Size:
    """Return the first size, with an interval that holds those of all."""
    return replace(
        sizes[0],
        low=min(size.low for size in sizes),
        high=max(size.high for size in sizes),
        p_value=max(size.p_value for size in sizes),
    )


@dataclass(frozen=True)
class _JumpsBeside:
    """The size of jumps, and of each pair's, beside bends of one time constant."""

    size: EffectSize
    pairs: list[which.PairEffect]


def _jumps_beside_bends(
    fit: KinkFit,
    landings: SectionLandings,
    comparison: Comparison,
    options: Options,
    levels: Mapping[str, float],
) -> list[_JumpsBeside]:
    """Return the jumps beside bends of each time constant, the likeliest first."""
    fits = fit.jumps_beside_bends(landings)
    root = comparing.squared_jump(fit, landings, comparison)
    alike = any(err_alike(one.scores @ root.T) for one in fits)
    generator = named_generator(options.seed, "verdict", "jump")
    of_kinks, *of_jumps = signed_errors(
        [fit, *fits], options.flips, generator, alike=alike
    )
    maps = which.pairs_of_maps(fit, of_kinks, landings, comparison)
    beside = []
    for one, signed in zip(fits, of_jumps, strict=True):
        size = sizing.size_drawn(
            Draws(one, root, signed, alike=alike),
            one,
            level_found=levels["jump"],
            confidence=options.confidence,
            power=options.power,
        )
        jumps = which.pairs_of_jumps(
            replace(fit, jumps=one), signed, landings, comparison
        )
        of_pairs = which.pair_effects(
            [*maps, *jumps],
            alike=alike,
            joint_p_value=size.p_value,
            confidence=options.confidence,
        )
        beside.append(_JumpsBeside(size, of_pairs[len(maps) :]))
    return beside


def at_contact(
    fit: KinkFit,
    landings: SectionLandings,
    comparison: Comparison,
    over_landings: EffectSize,
    options: Options,
) -> AtContact:
    """Return the size at the simultaneous contact, from that over the landings."""
    root = comparing.squared_size(fit, landings, comparison)

    def size(slopes: KinkFit) -> EffectSize:
        return sizing.effect_size(
            slopes,
            root,
            generator=named_generator(options.seed, "verdict", "contact"),
            confidence=options.confidence,
            power=options.power,
            flips=options.flips,
        )

    return sizing.at_the_contact(
        fit,
        landings,
        over_landings,
        size,
        generator=named_generator(options.seed, "verdict", "saturation"),
        flips=options.flips,
    )
