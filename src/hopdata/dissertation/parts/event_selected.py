"""Event-selected systems (sections 1.1 to 1.4, 2.1.2 and 3.4.1): items 1 to 9.

The definitions and both columns of table 1.1 are answered by `check_c1` for the hopper
and for systems that miss one line each. Saltation matrices and the Bouligand derivative
are compared with differences of the integrator, which knows nothing of them: it follows
neighbouring trajectories through their own contacts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray, pd
from hopdata.dissertation.rows import Agreement, Made, Row, over_seeds
from hopdata.hybrid import System, solve
from hopdata.hybrid.first_order import (
    bouligand_derivative,
    check_c1,
    derivative_without_saltation,
)
from hopdata.hybrid.first_order.event_selected import (
    CONTINUOUS,
    EVENT_FUNCTIONS,
    EXTENDED,
    KEPT,
    ONCE,
    liveness_constant,
)
from hopdata.hybrid.first_order.finding import Finding
from hopdata.hybrid.first_order.linearise import instant
from hopdata.hybrid.first_order.second_order import ADDITIVE, BY_POSITION, GROUPED
from hopdata.hybrid.first_order.smoothness import (
    IS_SELECTED,
    SmoothnessReport,
    spread,
)
from hopdata.hybrid.printed import (
    PrintedOptions,
    Stepping,
    integrate_alternating,
    region_of,
)
from hopdata.landings.schedules import count_mode_schedules
from hopdata.scenes.body import flight_mode
from hopdata.scenes.hopper import hopper_system
from hopdata.scenes.hopper_control import control_system
from hopdata.scenes.hopper_parameters import HopperParameters
from hopdata.scenes.octant import octant
from hopdata.scenes.scene import Control
from hopdata.scenes.vertical_hopper import VerticalHopper, hopper_states
from hopdata.synthesis.exact_maps import flying_system

if TYPE_CHECKING:
    from matplotlib.figure import Figure

HOPPER = HopperParameters()
FEET = ("foot1", "foot2", "foot3")
# The hopper as all feet touch: its velocity (m/s) and angular velocity (rad/s), which
# are those of a hop with kicks.
FALLING = (0.05, -0.03, -2.1, 0.1, -0.2, 0.05)
TIGHT: dict[str, Any] = {"rtol": 1e-12, "atol": 1e-14}
#: Relative difference below which a derivative is that of differences: theirs is some
#: 1e-8, by the integrator's error over the step.
#: Unit: 1. Origin: chosen.
SAME = 1e-5
#: Distance of two saltation products, over their effect, below which they are one.
#: Unit: 1. Origin: rounding: some thousand units in the last place.
ONE = 1e-12
#: Step of the differences across a landing.
#: Unit: m, rad, m/s, rad/s. Origin: chosen.
STEP = 1e-5
#: Time before and after the contact over which a landing is integrated.
#: Unit: s. Origin: chosen: the feet of a neighbour, a step away, touch within it.
AROUND_S = 0.01
#: Deviation of the neighbours along which the Bouligand derivative is tried.
#: Unit: m, rad, m/s, rad/s. Origin: chosen.
DEVIATION = 1e-6
#: Neighbours that are tried with each seed.
#: Unit: 1. Origin: chosen.
NEIGHBOURS = 12
#: Landings of hoppers with random legs that are tried with each seed.
#: Unit: 1. Origin: chosen.
LANDINGS = 4
# The hopper in one dimension of section 4.3.4, dropped from 2 m for some nine hops.
DROP_M = 2.0
HOPPING_S = 10.0
#: Error of the joined regions, relative to the drop, from which they would not be the
#: hopper any more.
#: Unit: 1. Origin: chosen.
JOINED = 1e-6


def make(seeds: Sequence[int]) -> Made:
    """Measure items 1 to 9."""
    reports = reports_of(checked_systems())
    rows = [
        *_definitions(reports),
        *checklist_rows(seeds, reports),
        _saltation(seeds),
        _bouligand(seeds),
        _commuting(reports),
        _joined(),
        _counted(),
    ]
    return Made(rows, {"table1_1": table_of(reports)})


def draw(tables: Mapping[str, pd.DataFrame]) -> dict[str, Figure]:
    """Draw table 1.1 with its numbers."""
    from hopdata.dissertation.figures.event_selected import checklist

    return {"table1_1": checklist(tables["table1_1"])}


# Systems that have all lines of the table, or miss one.


@dataclass(frozen=True)
class CheckedSystem:
    """A system at a state in which its guards are met.

    Attributes
    ----------
    name
        What it is, in a few words.
    system, state, params, mode
        As `check_c1` takes them.
    guards
        The guards that are crossed; None for those on whose surface the state is.
    missing
        The lines of the table that it is made to miss.
    """

    name: str
    system: System
    state: FloatArray
    params: FloatArray
    mode: Sequence[int]
    guards: tuple[str, ...] | None
    missing: tuple[str, ...] = ()

    def report(self) -> SmoothnessReport:
        """Return the answer of `check_c1`."""
        return check_c1(
            self.system,
            self.state,
            params=self.params,
            mode=self.mode,
            guards=self.guards,
        )


LANDING = "hopper, landing"
LIFT_OFF = "hopper, lift-off"
VERTICAL = "1-D hopper"
IMPACT = "impact, 10 %"
PLASTIC = "plastic impact"
GRAZING = "grazing feet"
COULOMB = "Coulomb friction"
OCTANT = "octant (Sec. 4.4.2)"
DELAYED = "velocity in guards"
COUPLED = "coupled legs"


def checked_systems() -> list[CheckedSystem]:
    """Return the systems of the table, those that miss nothing first."""
    vertical = VerticalHopper(rest_length_m=1.1)
    rubbing = replace(HOPPER, slip_velocity_m_s=1e-12)
    taking_off = _state(HOPPER.leg_length_m + HOPPER.release_extension_m, (0, 0, 2.0))
    # The contact of a delayed foot runs ahead of its gap, by delay times speed.
    delay = Control(delay_s=0.005)
    ahead = HOPPER.leg_length_m - delay.delay_s * FALLING[2]
    return [
        _landing(LANDING, HOPPER),
        CheckedSystem(
            LIFT_OFF,
            hopper_system(),
            taking_off,
            HOPPER.vector(),
            [1, 1, 1, 1, -1, 1, 1, 1, 1],
            FEET,
        ),
        CheckedSystem(
            VERTICAL,
            vertical.system(),
            np.array([1.0, -3.0]),
            np.array(vertical.params),
            [1],
            None,
        ),
        _control(IMPACT, Control(impulse=0.1), (CONTINUOUS,)),
        _control(PLASTIC, Control(impulse=1.0), (CONTINUOUS, KEPT)),
        _landing(GRAZING, HOPPER, speed=(0.05, -0.03, 0, 0, 0, 0), missing=(ONCE,)),
        _landing(COULOMB, rubbing, speed=(0, 0, -2.1, 0, 0, 0), missing=(EXTENDED,)),
        CheckedSystem(
            OCTANT,
            octant(),
            np.zeros(3),
            np.zeros(0),
            [-1, -1, -1],
            None,
            (GROUPED, BY_POSITION, ADDITIVE),
        ),
        CheckedSystem(
            DELAYED,
            control_system(),
            _state(ahead, (0.05, -0.03, -2.1)),
            HOPPER.vector(variant=delay),
            flight_mode(hopper_system(), -1.0).tolist(),
            FEET,
            (BY_POSITION,),
        ),
        _control(COUPLED, Control(coupling=0.1), (ADDITIVE,)),
    ]


def _state(height_m: float, speed: ArrayLike) -> FloatArray:
    """Return a level state of the hopper at this height with these velocities."""
    state = np.zeros(12)
    state[2] = height_m
    given = np.asarray(speed, dtype=np.float64)
    state[6 : 6 + len(given)] = given
    return state


def _landing(
    name: str,
    hopper: HopperParameters,
    *,
    speed: Sequence[float] = FALLING,
    missing: tuple[str, ...] = (),
) -> CheckedSystem:
    mode = flight_mode(hopper_system(), -1.0).tolist()
    state = _state(hopper.leg_length_m, speed)
    return CheckedSystem(
        name, hopper_system(), state, hopper.vector(), mode, FEET, missing
    )


def _control(name: str, control: Control, missing: tuple[str, ...]) -> CheckedSystem:
    mode = flight_mode(hopper_system(), -1.0).tolist()
    state = _state(HOPPER.leg_length_m, FALLING)
    params = HOPPER.vector(variant=control)
    return CheckedSystem(name, control_system(), state, params, mode, FEET, missing)


def table_of(reports: Mapping[str, SmoothnessReport]) -> pd.DataFrame:
    """Return a row for each system and line: which group, whether it holds, how far."""
    rows = []
    for name, report in reports.items():
        groups = {
            "definitions": report.definitions[1:],
            "ESS": report.ess,
            "FoPAS": report.fopas,
            "C1": (report.products,),
        }
        for group, findings in groups.items():
            for one in findings:
                rows.append((name, group, one.condition, one.passed, one.value))
    columns = ["system", "group", "condition", "holds", "value"]
    return pd.DataFrame(rows, columns=columns)


# Items 1 to 4: definitions and checklists.


def _definitions(reports: Mapping[str, SmoothnessReport]) -> list[Row]:
    """Return the rows on definitions 1.2.1 and 1.2.2."""
    landing = reports[LANDING]
    radius = 1e-3
    extended = _finding(landing, EXTENDED)
    return [
        Row(
            1,
            Agreement.BUILT,
            {
                "constant": _constant(LANDING, radius),
                "speed": -FALLING[2],
                "share": _finding(landing, EVENT_FUNCTIONS).value,
                "radius": radius,
                "grazing": _constant(GRAZING, radius),
            },
            "local",
        ),
        Row(
            2,
            Agreement.BUILT,
            {
                "gap": extended.value,
                "allowed": float(extended.needed.removeprefix("<= ")),
                "modes": 2 ** len(FEET),
                "coulomb": _finding(reports[COULOMB], EXTENDED).value,
                "coulomb_allowed": float(
                    _finding(reports[COULOMB], EXTENDED).needed.removeprefix("<= ")
                ),
            },
            "numerical",
        ),
    ]


def _constant(name: str, radius: float) -> float:
    """Return the constant of definition 1.2.1 for one of the systems."""
    one = next(system for system in checked_systems() if system.name == name)
    at = instant(one.system, one.state, params=one.params, mode=one.mode, t=0.0)
    feet = range(len(FEET))
    return liveness_constant(one.system, at, feet, np.ones(12), radius)


def _finding(report: SmoothnessReport, condition: str) -> Finding:
    """Return the line of a report with this condition."""
    findings = (*report.definitions, *report.ess, *report.fopas)
    return next(one for one in findings if one.condition == condition)


def reports_of(systems: Sequence[CheckedSystem]) -> dict[str, SmoothnessReport]:
    """Return the answers of `check_c1` by the systems' names."""
    return {system.name: system.report() for system in systems}


def checklist_rows(
    seeds: Sequence[int], reports: Mapping[str, SmoothnessReport] | None = None
) -> list[Row]:
    """Return the rows on the two columns of table 1.1, of all checked systems."""
    if reports is None:
        reports = reports_of(checked_systems())
    wrong_left = 0
    wrong_right = 0
    for system in checked_systems():
        report = reports[system.name]
        left = [one.condition for one in report.ess if not one.passed]
        right = [one.condition for one in report.fopas[1:] if not one.passed]
        expected = set(system.missing)
        wrong_left += set(left) != expected & {CONTINUOUS, ONCE, KEPT}
        wrong_right += set(right) != expected & {GROUPED, BY_POSITION, ADDITIVE}
    impact = reports[IMPACT]
    return [
        Row(
            3,
            Agreement.BUILT if wrong_left == 0 else Agreement.DIFFERS,
            {
                "lines": len(reports[LANDING].ess),
                "systems": len(reports),
                "wrong": wrong_left,
                "kept": _finding(reports[LANDING], KEPT).value,
                "jump": _finding(impact, CONTINUOUS).value,
                "impact_kept": _finding(impact, KEPT).value,
                "plastic_kept": abs(_finding(reports[PLASTIC], KEPT).value),
                "grazing": _finding(reports[GRAZING], ONCE).value,
                "pairs": len(FEET) * 2 ** len(FEET),
            },
            "impacts",
        ),
        _classical_jacobian(reports, wrong_right, seeds),
    ]


def _agreement(holds: bool) -> Agreement:
    """Return whether a claim agrees, for one that holds or not."""
    if holds:
        return Agreement.AGREES
    return Agreement.DIFFERS


def _classical_jacobian(
    reports: Mapping[str, SmoothnessReport], wrong: int, seeds: Sequence[int]
) -> Row:
    """Return the row on force-position additive systems, which have one Jacobian."""
    widest = over_seeds(lambda seed: _widest_spread(seed, None), seeds)
    coupling = Control(coupling=0.1)
    narrowest = over_seeds(lambda seed: _widest_spread(seed, coupling), seeds)
    fopas = [report.products.value for report in reports.values() if report.is_fopas]
    holds = wrong == 0 and max(*widest, *fopas) < ONE < min(narrowest)
    values = {
        "lines": len(reports[LANDING].fopas),
        "systems": len(reports),
        "wrong": wrong,
        "spread": widest,
        "landings": LANDINGS,
        "coupled": narrowest,
        "coupling": coupling.coupling,
        "velocity_share": _finding(reports[DELAYED], BY_POSITION).value,
        "delayed": reports[DELAYED].products.value,
        "not_selected": _finding(reports[IMPACT], IS_SELECTED).value,
    }
    return Row(4, _agreement(holds), values, "sufficient")


def _widest_spread(seed: int, control: Control | None) -> float:
    """Return the largest spread of products over landings of hoppers drawn at random.

    Mass, inertia, stiffness, damping, friction, each leg's preload and the velocities
    are drawn within a factor of two. With a control it is the smallest spread.
    """
    rng = np.random.default_rng(np.random.SeedSequence([seed, 4]))
    drawn = ("mass_kg", "inertia_x_kg_m2", "stiffness_n_m", "damping_n_s_m", "friction")
    spreads = []
    for _ in range(LANDINGS):
        factors = dict(zip(drawn, 2.0 ** rng.uniform(-1, 1, len(drawn)), strict=True))
        hopper = replace(
            HOPPER, **{name: getattr(HOPPER, name) * by for name, by in factors.items()}
        )
        preloads = HOPPER.preload_n * 2.0 ** rng.uniform(-1, 1, len(FEET))
        speeds = np.array(FALLING) + rng.normal(0.0, 0.2, 6)
        system = hopper_system()
        if control is not None:
            system = control_system()
        report = check_c1(
            system,
            _state(hopper.leg_length_m, speeds),
            params=hopper.vector(preloads, control),
            mode=flight_mode(hopper_system(), -1.0).tolist(),
            guards=FEET,
        )
        spreads.append(report.products.value)
    if control is not None:
        return min(spreads)
    return max(spreads)


# Items 5 to 7: saltation matrices, the Bouligand derivative, and commuting.


def _saltation(seeds: Sequence[int]) -> Row:
    """Return the row on saltation matrices: the derivative across a landing."""
    errors = over_seeds(_derivative_errors, seeds)
    with_them = [found[0] for found in errors]
    without = [found[1] for found in errors]
    holds = max(with_them) < SAME < min(without)
    values = {
        "error": with_them,
        "without": without,
        "contacts": [found[2] for found in errors],
    }
    return Row(5, _agreement(holds), values)


def _derivative_errors(seed: int) -> tuple[float, float, int]:
    """Return the errors of the derivative of a hop, with and without saltations.

    They are the largest differences from central differences of the integrator, over
    the largest entry. The third number is that of the contacts made and broken.
    """
    rng = np.random.default_rng(np.random.SeedSequence([seed, 5]))
    start = _state(0.5, (0.1, -0.05, -0.01, 0.1, -0.2, 0.1))
    start[3:6] = rng.normal(0.0, 0.03, 3)
    start[9:] += rng.normal(0.0, 0.1, 3)
    mode = flight_mode(hopper_system(), -1.0).tolist()
    span = (0.0, 0.55)  # from the apex to beyond lift-off
    params = HOPPER.vector()

    def end(y: FloatArray) -> FloatArray:
        found = solve(hopper_system(), span, y, params=params, mode=mode, **TIGHT)
        return found.y_end

    # The derivative by five points, whose error is of the fourth order of the step.
    columns = []
    for step in STEP * np.eye(12):
        change = (
            end(start - 2 * step)
            - 8 * end(start - step)
            + 8 * end(start + step)
            - end(start + 2 * step)
        )
        columns.append(change / (12 * STEP))
    exact = np.array(columns).T
    options: dict[str, Any] = {"params": params, "mode": mode, **TIGHT}
    whole = solve(hopper_system(), span, start, jacobian=True, **options)
    assert whole.jacobian is not None
    _, without, _ = derivative_without_saltation(
        hopper_system(), span, start, **options
    )
    size = np.abs(exact).max()
    contacts = int((whole.events.guard < len(FEET)).sum())
    return (
        float(np.abs(whole.jacobian - exact).max() / size),
        float(np.abs(without - exact).max() / size),
        contacts,
    )


def _bouligand(seeds: Sequence[int]) -> Row:
    """Return the row on the Bouligand derivative, where there is no Jacobian."""
    found = over_seeds(_directional_errors, seeds)
    own = [errors[0] for errors in found]
    other = [errors[1] for errors in found]
    smooth = [errors[2] for errors in found]
    holds = max(*own, *smooth) < 1e3 * DEVIATION < min(other)
    values = {
        "own": own,
        "other": other,
        "smooth": smooth,
        "orders": [errors[3] for errors in found],
        "deviation": DEVIATION,
        "neighbours": NEIGHBOURS,
        "coupling": 0.4,
    }
    return Row(6, _agreement(holds), values)


def _directional_errors(seed: int) -> tuple[float, float, float, int]:
    """Return errors of directional derivatives of a landing on three feet at once.

    With coupled legs: of the piece of the order in which a neighbour lands, the largest
    over the neighbours, and of the piece of another neighbour's order, the largest too.
    With the hopper: of one matrix for all. The last number is how many orders occur.
    """
    coupled = _control("", Control(coupling=0.4), ())
    own, other, orders = _piece_errors(coupled, seed)
    smooth, _, _ = _piece_errors(_landing("", HOPPER), seed)
    return own, other, smooth, orders


def _piece_errors(checked: CheckedSystem, seed: int) -> tuple[float, float, int]:
    """Return the largest errors of the own pieces and of one piece, and the orders.

    A neighbour starts in flight before the contact and ends in stance after it. The
    flow's derivative over both times is classical, so the directional derivative is
    that of flight, then a piece of the Bouligand derivative, then that of stance.
    """
    rng = np.random.default_rng(np.random.SeedSequence([seed, 6]))
    system, params = checked.system, checked.params
    options: dict[str, Any] = {"params": params, **TIGHT}
    back = (0.0, -AROUND_S)
    start = solve(flying_system(system), back, checked.state, **options).y_end
    pause = 1e-9 * AROUND_S
    flight = solve(
        system,
        (-AROUND_S, -pause),
        start,
        mode=checked.mode,
        jacobian=True,
        **options,
    )
    flow = bouligand_derivative(
        system, checked.state, params=params, mode=checked.mode, guards=checked.guards
    )
    standing = flow.node(flow.guards).here.instant
    stance = solve(
        system,
        (0.0, AROUND_S),
        standing.y,
        mode=standing.mode.tolist(),
        jacobian=True,
        **options,
    )
    assert flight.jacobian is not None
    assert stance.jacobian is not None
    own: list[float] = []
    other: list[float] = []
    found = set()
    first_piece = None
    for _ in range(NEIGHBOURS):
        v = rng.normal(size=12)
        v /= np.linalg.norm(v)
        at_contact = flight.jacobian @ v
        end = solve(
            system,
            (-AROUND_S, AROUND_S),
            start + DEVIATION * v,
            mode=checked.mode,
            **options,
        ).y_end
        exact = (end - stance.y_end) / DEVIATION
        order = flow.order(at_contact)
        found.add(order)
        piece = flow.node(order).product
        if first_piece is None:
            first_piece = piece
        size = np.linalg.norm(exact)
        for errors, matrix in ((own, piece), (other, first_piece)):
            guess = stance.jacobian @ (matrix @ at_contact)
            errors.append(float(np.linalg.norm(guess - exact) / size))
    return max(own), max(other), len(found)


def _commuting(reports: Mapping[str, SmoothnessReport]) -> Row:
    """Return the row on saltation matrices that commute."""
    spreads = {name: report.products.value for name, report in reports.items()}
    legs = [_spread_of_legs(n_legs) for n_legs in (2, 3, 4)]
    together = max(spreads[LANDING], spreads[LIFT_OFF], *legs)
    apart = min(spreads[OCTANT], spreads[COUPLED], spreads[DELAYED])
    holds = together < ONE < apart
    values = {
        "landing": spreads[LANDING],
        "lift_off": spreads[LIFT_OFF],
        "most_legs": max(legs),
        "coupled": spreads[COUPLED],
        "delayed": spreads[DELAYED],
        "octant": spreads[OCTANT],
    }
    return Row(7, _agreement(holds), values)


def _spread_of_legs(n_legs: int) -> float:
    """Return the spread of the products of a landing on this many legs at once."""
    hopper = HopperParameters(n_legs=n_legs)
    flow = bouligand_derivative(
        hopper_system(n_legs),
        _state(hopper.leg_length_m, FALLING),
        params=hopper.vector(),
        mode=flight_mode(hopper_system(n_legs), -1.0).tolist(),
        guards=[f"foot{leg + 1}" for leg in range(n_legs)],
    )
    return spread([order.matrix for order in flow.pieces()])


# Items 8 and 9: rhythmic systems, and how many mode schedules they have.


def _joined() -> Row:
    """Return the row on a rhythmic system made of event-selected ones."""
    from scipy.integrate import RK45

    hopper = VerticalHopper()
    start = np.array([DROP_M, 0.0])
    span = (0.0, HOPPING_S)
    exact = hopper_states(hopper, DROP_M, [HOPPING_S])[:, 0]
    falling, rising = (
        region_of(hopper.system(), hopper.params, orientation=(way,)) for way in (-1, 1)
    )
    step = 0.01
    joined = integrate_alternating(
        falling,
        rising,
        span,
        start,
        solver=Stepping(RK45, {"rtol": 1e-9, "atol": 1e-12, "max_step": step}),
        options=PrintedOptions(tail="restart"),
    )
    whole = solve(
        hopper.system(), span, start, params=hopper.params, jacobian=True, **TIGHT
    )
    assert whole.jacobian is not None
    pieces = _product_over_regions(hopper, start)
    product_error = np.abs(pieces - whole.jacobian).max() / np.abs(whole.jacobian).max()
    error = float(np.abs(whole.y_end - exact).max() / DROP_M)
    printed = float(np.abs(joined.y_end - exact).max() / DROP_M)
    holds = max(error, float(product_error)) < JOINED
    holds = holds and len(joined.events) == len(whole.events)
    values = {
        "seconds": HOPPING_S,
        "events": len(whole.events),
        "printed_events": len(joined.events),
        "printed_error": printed,
        "step": step,
        "error": error,
        "product_error": float(product_error),
        "determinant": float(np.linalg.det(whole.jacobian)),
    }
    return Row(8, _agreement(holds), values)


def _product_over_regions(hopper: VerticalHopper, start: FloatArray) -> FloatArray:
    """Return the product of the derivatives of regions that end where it turns.

    Each region, from apex to lowest point or from there to apex, crosses the contact
    once, so it is event-selected; the time at which they are joined is free.
    """
    omega = np.sqrt(hopper.stiffness_n_m / hopper.mass_kg)
    speed = np.sqrt(2 * hopper.gravity_m_s2 * (DROP_M - hopper.contact_length_m))
    fall = speed / hopper.gravity_m_s2
    down = np.arctan2(speed / omega, -hopper.gravity_m_s2 / omega**2) / omega
    half = fall + down
    times = [*np.arange(0.0, HOPPING_S, half), HOPPING_S]
    product = np.eye(2)
    state = start
    mode: list[int] | None = [1]
    for begin, end in pairwise(times):
        piece = solve(
            hopper.system(),
            (begin, end),
            state,
            params=hopper.params,
            mode=mode,
            jacobian=True,
            **TIGHT,
        )
        assert piece.jacobian is not None
        product = piece.jacobian @ product
        state = piece.y_end
        mode = piece.mode.tolist()
    return product


def _counted() -> Row:
    """Return the row on the number of mode schedules."""
    counts = {f"hops{n}": count_mode_schedules(len(FEET), n) for n in (1, 2, 3)}
    printed = {"hops1": 36, "hops2": 1_296, "hops3": 46_656}
    # The text gives 46,656 and, for the same three hops in section 3.5, 1,296.
    holds = counts == printed
    agreement = Agreement.DIFFERS
    if holds:
        agreement = Agreement.PARTLY
    return Row(
        9, agreement, {**counts, "times": counts["hops3"] / counts["hops2"]}, "two"
    )
