"""Sec. 2.2: from the recording to labelled touchdowns, by both methods on the sample.

The bundled sample was simulated, so its truth is known: each stage is scored by it.
What is random is repeated on new recordings, one a seed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from hopdata.arrays import BoolArray, FloatArray, pd
from hopdata.dissertation.rows import Agreement, Made, Row
from hopdata.dissertation.sample import SAMPLE, study_of, truth_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from hopdata.landings.sections.frames import Heights
    from hopdata.recording import Recording
    from hopdata.truth import Truth
    from hopdata.walk import Study

# The studies that are measured, in a checkout.
SAMPLE_FILE = SAMPLE
THESIS_FILE = "config/thesis.yaml"

# What the dissertation prints, with its section.
DROP_SHARE = 0.4  # 2.2.1
FRAMES = 182_611  # 2.2.1
HOPS = 2860  # 2.2.1
RATE_HZ = 100.0  # 2.2.1
NOISE_M = 0.6e-3  # 2.2.1
LENGTH_M = 29.13e-3  # Fig. 2.4
TIME_S = 27e-3  # Fig. 2.4
WORST_POSITION_M = 4e-3  # 2.3
WORST_VELOCITY_M_S = 0.14  # 2.3
BODY_MARKERS = 3  # 2.2.1

#: Bandwidths of the densities with which the printed rule is run, m: a hundredfold.
#: Unit: m. Origin: chosen.
BANDWIDTHS_M = (1e-4, 3e-4, 1e-3, 3e-3, 1e-2)

#: Relative difference up to which a measured number agrees with a printed one that has
#: two digits.
#: Unit: 1. Origin: chosen.
CLOSE = 0.1

#: Share of frames or landings that counts as all, where the text says "any" or "all".
#: Unit: 1. Origin: chosen.
NEARLY_ALL = 0.99

#: Share by which the preload of one leg is raised, to steer by contact forces.
#: Unit: 1. Origin: chosen.
PUSHED = 0.2

#: Share of frames from which a section is partly one that the text ensures.
#: Unit: 1. Origin: chosen.
MOST = 0.9

#: Hops of the recordings in which the two readings of the noise are measured.
#: Unit: hops. Origin: chosen.
NOISE_HOPS = 30

#: Frames that a figure shows.
#: Unit: frames. Origin: chosen.
SHOWN_FRAMES = 8000

#: Swing of the boom in flight: the largest of the steering's robot.
#: Unit: rad. Origin: derived: the default of steering.robot.swing_limit_rad.
SWING_RAD = 1.1780972450961724


@dataclass(frozen=True)
class _Both:
    """The sample by the printed methods and by hopdata's, and its truth."""

    printed: Study
    ours: Study
    truth: Truth

    @property
    def recording(self) -> Recording:
        """The recording on its level floor, which is the same in both studies."""
        return self.ours.recordings[0]


def make(seeds: Sequence[int]) -> Made:
    """Measure items 11 and 15 to 31; see `hopdata.dissertation.parts`."""
    both = _both()
    again = [_thesis_trial(seed) for seed in seeds]
    rows = [
        _boom(),
        _preload(),
        _drop_test(),
        _markers(both),
        _frames_and_hops(again, seeds),
        _noise(both, seeds),
        _floor(both),
        _level_sets(both),
        _two_modes(both),
        _thresholds(both),
        _section_heights(both, again),
        _section_figure(both),
        _velocity_minimum(both),
        _default_labels(both),
        _excluded(both),
        _schedule_figure(both),
        _home_frame(both, seeds),
        _units(both),
    ]
    return Made(rows, _tables(both))


def draw(tables: Mapping[str, pd.DataFrame]) -> Mapping[str, Figure]:
    """Draw Figs. 2.2 and 2.3 by both methods."""
    from hopdata.dissertation.figures import labels

    return {
        "fig2_2_both": labels.sections_by_both(tables),
        "fig2_3_both": labels.schedule_by_both(tables),
    }


def _both() -> _Both:
    return _Both(
        printed=study_of(SAMPLE_FILE, printed=True),
        ours=study_of(SAMPLE_FILE),
        truth=truth_of(SAMPLE_FILE),
    )


def _agrees(holds: bool, otherwise: Agreement = Agreement.DIFFERS) -> Agreement:
    if holds:
        return Agreement.AGREES
    return otherwise


def _built(holds: bool) -> Agreement:
    """Return that a design or a rule is built, if it does what it should."""
    if holds:
        return Agreement.BUILT
    return Agreement.DIFFERS


def _close(found: float, printed: float) -> bool:
    return abs(found / printed - 1) <= CLOSE


# The robot: boom, preload, drop test, markers.


def _boom() -> Row:
    """Item 11: the boom moves in flight, and turns the body by conservation."""
    from hopdata.scenes.hopper_parameters import HopperParameters
    from hopdata.synthesis.hops import fly_hop, level_state

    still = HopperParameters()
    swung = replace(still, boom_swing_rad=SWING_RAD)
    start = level_state(swung, 0.24)
    times = np.arange(0.0, swung.boom_duration_s + 0.05, 0.005)
    hop = fly_hop(swung, start, frame_times_s=times)
    rest = fly_hop(still, start)
    kept, moved = _angular_momentum(swung, times, hop.states)
    by_boom = np.abs(kept).max() / np.abs(moved).max()
    yaw_deg = float(np.degrees(hop.states[-1, 3]))
    drift_m = hop.end_state[:2] - rest.end_state[:2]
    turns_back = yaw_deg * SWING_RAD < 0
    values = {
        "swing": float(np.degrees(SWING_RAD)),
        "yaw": yaw_deg,
        "momentum": float(by_boom),
        "drift": 1e3 * float(np.hypot(*drift_m)),
    }
    # The same by contact forces: one leg pushes more than the others.
    preloads = still.preload_n * np.array([1 + PUSHED, *[1.0] * (still.n_legs - 1)])
    pushed = fly_hop(still, start, preloads_n=preloads)
    values["pushed"] = 100 * PUSHED
    values["pushed_yaw"] = abs(float(np.degrees(pushed.end_state[3])))
    pushed_m = pushed.end_state[:2] - rest.end_state[:2]
    values["pushed_drift"] = 1e3 * float(np.hypot(*pushed_m))
    agreement = Agreement.DIFFERS
    if turns_back and by_boom < 1e-6 and values["drift"] > 1:
        turns_more = abs(yaw_deg) > values["pushed_yaw"]
        moves_more = values["drift"] > values["pushed_drift"]
        agreement = _agrees(turns_more and moves_more, Agreement.PARTLY)
    return Row(11, agreement, values, "forces")


def _angular_momentum(
    hopper: Any, times: FloatArray, states: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the angular momentum about the centre of mass, and the boom's share.

    Both (K, 3), kg m^2/s, in body axes.
    """
    from hopdata.scenes.hopper import boom_motion

    mass = hopper.counterweight_mass_kg
    reduced = mass * (1 - mass / (mass + hopper.mass_kg))
    inertia = np.array(
        [hopper.inertia_x_kg_m2, hopper.inertia_y_kg_m2, hopper.inertia_z_kg_m2]
    )
    whole = []
    of_boom = []
    for time, state in zip(times, states, strict=False):
        place, velocity, _ = boom_motion.py_func(time, hopper.vector())
        turning = state[9:12]
        by_swing = reduced * np.cross(place, velocity)
        carried = reduced * np.cross(place, np.cross(turning, place))
        whole.append(inertia * turning + carried + by_swing)
        of_boom.append(by_swing)
    return np.array(whole), np.array(of_boom)


def _preload() -> Row:
    """Item 15: the force at contact jumps to the preload, and is affine."""
    from hopdata.scenes.body import rotation_entries
    from hopdata.scenes.hopper import leg_wrench
    from hopdata.scenes.hopper_parameters import HopperParameters
    from hopdata.synthesis.hops import level_state

    hopper = HopperParameters()
    numbers = hopper.vector()
    upright = rotation_entries(0.0, 0.0, 0.0)
    laws = []
    forces = []
    for gap in np.linspace(-0.1, 0.0, 5):
        for climb in np.linspace(-2.0, 2.0, 5):
            state = level_state(hopper, gap)
            state[8] = climb
            force, _ = leg_wrench(0, state, upright, numbers)
            laws.append((1.0, gap, climb))
            forces.append(force[2])
    law = np.array(laws)
    normal = np.array(forces)
    fitted = np.linalg.lstsq(law, normal, rcond=None)[0]
    residual = float(np.abs(law @ fitted - normal).max())
    is_affine = residual < 1e-9 and fitted[0] > 0
    values = {"jump": float(fitted[0]), "residual": residual}
    return Row(15, _built(is_affine), values)


def _drop_test() -> Row:
    """Item 16: legs without release, dropped from the hopping height."""
    from hopdata.scenes.hopper_parameters import HopperParameters
    from hopdata.synthesis.hops import rebound

    hopper = HopperParameters()
    height_m = 0.24
    passive = rebound(replace(hopper, release_extension_m=0.0), height_m)
    damped = replace(hopper, release_extension_m=0.0, damping_n_s_m=30.0)
    deadbeat = rebound(damped, height_m)
    values = {
        "height": 1e3 * height_m,
        "share": 100 * passive,
        "hopping": 100 * rebound(hopper, height_m),
        "damped": 100 * deadbeat,
    }
    return Row(16, _agrees(passive > DROP_SHARE > deadbeat), values)


def _markers(both: _Both) -> Row:
    """Item 17: markers of the body, and one a foot."""
    roles = both.recording.roles
    body = roles.count("body")
    feet = roles.count("foot")
    legs = both.truth.contact_times.shape[1]
    values = {"body": body, "feet": feet, "legs": legs}
    return Row(17, _built(body == BODY_MARKERS and feet == legs), values)


# The recording: its size, its noise, its floor.


def _thesis_trial(seed: int) -> tuple[Recording, Truth]:
    """Simulate a quarter of a recording of the printed size, over a level floor."""
    from hopdata.config.loading import load_config
    from hopdata.synthesis import simulate_recording

    config = load_config(THESIS_FILE, check_files=False)
    first = config["recordings"][0]["simulation"]["duration_s"]
    level = {"bowl_depth_m": 0.0, "waves": 0}
    return simulate_recording(
        {**config["simulation"], "duration_s": first},
        {**config["motion_capture"], "floor": level},
        seed=(seed, 0),
    )


def _frames_and_hops(
    again: Sequence[tuple[Recording, Truth]], seeds: Sequence[int]
) -> Row:
    """Item 18: the study of the printed size."""
    from hopdata.config.loading import load_config

    config = load_config(THESIS_FILE, check_files=False)
    rate_hz = config["motion_capture"]["rate_hz"]
    frames = 0
    for entry in config["recordings"]:
        # A frame at the beginning, and one each period.
        frames += int(np.ceil(entry["simulation"]["duration_s"] * rate_hz - 1e-6))
    each_s = []
    hops = []
    for recording, truth in again:
        hops_a_frame = len(truth.apex_times) / len(recording.time)
        each_s.append(1 / hops_a_frame / rate_hz)
        hops.append(hops_a_frame * FRAMES)
    values = {
        "frames": frames,
        "rate": rate_hz,
        "seeds": len(seeds),
        "printed_hop": FRAMES / RATE_HZ / HOPS,
        "hop": each_s,
        "hops": hops,
        "simulated": [len(recording.time) for recording, _ in again],
    }
    agrees = frames == FRAMES and rate_hz == RATE_HZ
    return Row(18, _agrees(agrees and _close(np.median(hops), HOPS)), values)


def _noise(both: _Both, seeds: Sequence[int]) -> Row:
    """Item 19: both readings of the noise, and what the distances of pairs give."""
    from hopdata.synthesis import simulate_recording

    of_pairs: dict[str, list[float]] = {"coordinate": [], "distance": []}
    for noise_of, found in of_pairs.items():
        for seed in seeds:
            camera = {"noise_m": NOISE_M, "noise_of": noise_of}
            recording, _ = simulate_recording(
                {"hops": NOISE_HOPS}, camera, seed=(seed, 1)
            )
            found.append(1e3 * _pair_noise(recording))
    sample_mm = 1e3 * _pair_noise(both.recording)
    true_mm = 1e3 * both.truth.noise_m
    values = {
        "pairs": sample_mm,
        "coordinate": float(sample_mm / np.sqrt(2)),
        "true": true_mm,
        "harder": of_pairs["coordinate"],
        "easier": of_pairs["distance"],
    }
    printed_mm = 1e3 * NOISE_M
    by_coordinate = _close(np.median(of_pairs["coordinate"]) / np.sqrt(2), printed_mm)
    by_distance = _close(np.median(of_pairs["distance"]), printed_mm)
    return Row(19, _built(by_coordinate and by_distance), values, "two_readings")


def _pair_noise(recording: Recording) -> float:
    """Return the mean error of the distances between body markers, m."""
    from hopdata.recordings.quality.rigid import pair_distances

    spread = pair_distances(recording.body).spread
    return float(spread[np.triu_indices(len(spread), 1)].mean())


def _floor(both: _Both) -> Row:
    """Item 20: the floor that was found, and what becomes of a study without it."""
    from hopdata.maps.truth.scoring import score_floor

    known = {both.recording.name: both.truth}
    residual = score_floor(known, both.ours.floors)["floor_residual_rms"]["value"]
    true_floor = both.truth.floor_at_contacts
    curved = float(np.nanstd(true_floor))
    used = {}
    for name in ("printed", "ours"):
        by_print = name == "printed"
        flat = study_of(SAMPLE_FILE, printed=by_print, floor={"enabled": False})
        used[name] = _n_used(flat)
    values = {
        "curvature": 1e3 * curved,
        "residual": float(residual),
        "printed_with": _n_used(both.printed),
        "printed_without": used["printed"],
        "ours_with": _n_used(both.ours),
        "ours_without": used["ours"],
    }
    compensated = residual < 0.5 * values["curvature"]
    return Row(20, _built(compensated), values, "slight")


def _n_used(found: Study) -> int:
    return int((~found.touchdowns["excluded"].astype(bool)).sum())


# The sections.


def _level_sets(both: _Both) -> Row:
    """Item 21: each landing passes both heights, once, on its way down."""
    shares = {}
    speeds = {}
    for name, found in (("printed", both.printed), ("ours", both.ours)):
        sections = found.sections
        times = found.touchdowns[["t_pre_s", "t_post_s"]].to_numpy(float)
        passed = np.isfinite(times).all(axis=1)
        n_landings = int(both.truth.complete.sum())
        shares[name] = 100 * float(passed.sum() / n_landings)
        slowest = min(sections.pre_speed_m_s or 0.0, sections.post_speed_m_s or 0.0)
        speeds[name] = slowest
    values = {
        "printed_share": shares["printed"],
        "ours_share": shares["ours"],
        "printed_speed": speeds["printed"],
        "ours_speed": speeds["ours"],
    }
    are_sections = min(shares.values()) >= 100 * NEARLY_ALL and min(speeds.values()) > 0
    return Row(21, _agrees(are_sections), values)


def _two_modes(both: _Both) -> Row:
    """Item 22: the densities of the lowest and the highest foot have two modes."""
    heights = _heights(both.recording)
    width_m = float(both.printed.sections.bandwidth_m or 0.0)
    values = {"bandwidth": 1e3 * width_m}
    two_modes = []
    for name, foot in (("lowest", heights.min_foot), ("highest", heights.max_foot)):
        lower_m, upper_m, ratio, dip = _modes(foot, width_m)
        values[f"{name}_lower"] = 1e3 * lower_m
        values[f"{name}_upper"] = 1e3 * upper_m
        values[f"{name}_ratio"] = ratio
        values[f"{name}_dip"] = 100 * dip
        two_modes.append(dip < 1 < ratio)
    return Row(22, _agrees(all(two_modes)), values)


def _modes(
    heights: FloatArray, bandwidth_m: float
) -> tuple[float, float, float, float]:
    """Return both modes, m, the ratio of their densities, and the dip between them.

    The modes are the highest points of the density below and above half of the range;
    the dip is the lowest density between them, relative to that of the upper one.
    """
    from hopdata.landings.sections.densities import finite, grid_of, kde

    known = finite(heights)
    grid = grid_of(known, bandwidth_m)
    density = kde(known, bandwidth=bandwidth_m, grid=grid)
    half = len(grid) // 2
    low = int(np.argmax(density[:half]))
    high = half + int(np.argmax(density[half:]))
    dip = float(density[low:high].min() / density[high])
    ratio = float(density[low] / density[high])
    return float(grid[low]), float(grid[high]), ratio, dip


def _heights(recording: Recording) -> Heights:
    from hopdata.landings.sections.frames import heights_of

    return heights_of(recording)


def _thresholds(both: _Both) -> Row:
    """Item 23: thresholds of the feet, over bandwidths; frames whose state is right."""
    heights = _heights(both.recording)
    lowest = []
    highest = []
    for width_m in BANDWIDTHS_M:
        found = _by_knees(heights, width_m)
        lowest.append(1e3 * found["min_foot_threshold_m"])
        highest.append(1e3 * found["max_foot_threshold_m"])
    printed = both.printed.sections
    ours = both.ours.sections
    values = {
        "printed_low": 1e3 * printed.min_foot_threshold_m,
        "printed_high": 1e3 * printed.max_foot_threshold_m,
        "bandwidth": 1e3 * float(printed.bandwidth_m or 0.0),
        "narrow": 1e3 * BANDWIDTHS_M[0],
        "wide": 1e3 * BANDWIDTHS_M[-1],
        "low_from": lowest[0],
        "low_to": lowest[-1],
        "high_from": highest[0],
        "high_to": highest[-1],
        "printed_right": 100 * _states_right(both, printed),
        "low": 1e3 * ours.min_foot_threshold_m,
        "high": 1e3 * ours.max_foot_threshold_m,
        "right": 100 * _states_right(both, ours),
    }
    return Row(23, Agreement.BUILT, values, "bandwidth")


def _states_right(both: _Both, sections: Any) -> float:
    """Return the share of frames whose "all up" and "all down" are both right."""
    heights = _heights(both.recording)
    n_down = both.truth.foot_down.sum(axis=1)
    all_up = heights.min_foot > sections.min_foot_threshold_m
    all_down = heights.max_foot < sections.max_foot_threshold_m
    n_feet = both.truth.foot_down.shape[1]
    right = (all_up == (n_down == 0)) & (all_down == (n_down == n_feet))
    return float(right[heights.seen].mean())


def _by_knees(heights: Heights, bandwidth_m: float) -> dict[str, float]:
    """Return thresholds and sections by the printed rule, m."""
    from hopdata.landings.sections.densities import finite
    from hopdata.landings.sections.frames import pool_frames
    from hopdata.landings.sections.from_densities import (
        heights_from_densities,
        upper_knee,
    )
    from hopdata.landings.sections.modes import ground_mode

    lowest_m = upper_knee(finite(heights.min_foot), bandwidth_m)
    highest_m = upper_knee(finite(heights.max_foot), bandwidth_m)
    frames = pool_frames(
        [heights],
        min_foot_m=lowest_m,
        max_foot_m=highest_m,
        ground_m=ground_mode(heights.min_foot).height_m,
    )
    pre_m, post_m = heights_from_densities(frames, bandwidth_m)
    return {
        "min_foot_threshold_m": lowest_m,
        "max_foot_threshold_m": highest_m,
        "pre_height_m": pre_m,
        "post_height_m": post_m,
    }


def _section_heights(both: _Both, again: Sequence[tuple[Recording, Truth]]) -> Row:
    """Item 24: heights of the sections, and whether they keep what the text says."""
    heights = _heights(both.recording)
    by_width = [_by_knees(heights, width_m) for width_m in BANDWIDTHS_M]
    width_m = float(both.printed.sections.bandwidth_m or 0.0)
    others = [_by_knees(_heights(recording), width_m) for recording, _ in again]
    values: dict[str, Any] = {
        "narrow": 1e3 * BANDWIDTHS_M[0],
        "wide": 1e3 * BANDWIDTHS_M[-1],
        "bandwidth": 1e3 * width_m,
        "again_pre": [1e3 * one["pre_height_m"] for one in others],
        "again_post": [1e3 * one["post_height_m"] for one in others],
    }
    for side in ("pre", "post"):
        each_mm = [1e3 * one[f"{side}_height_m"] for one in by_width]
        values[f"{side}_from"] = min(each_mm)
        values[f"{side}_to"] = max(each_mm)
    kept = {}
    for name, found in (("printed", both.printed), ("ours", both.ours)):
        sections = found.sections
        values[f"{name}_pre"] = 1e3 * sections.pre_height_m
        values[f"{name}_post"] = 1e3 * sections.post_height_m
        travel_m = sections.pre_height_m - sections.post_height_m
        values[f"{name}_travel"] = 1e3 * travel_m
        kept[name] = _landings_inside(both, found)
        values[f"{name}_inside"] = 100 * kept[name]
        values[f"{name}_all_down"] = 100 * _down_below(both, sections.post_height_m)
    ensured = values["printed_all_down"] >= 100 * NEARLY_ALL
    holds = ensured and kept["printed"] >= NEARLY_ALL
    agreement = Agreement.DIFFERS
    if values["printed_all_down"] >= 100 * MOST:
        agreement = _agrees(holds, Agreement.PARTLY)
    return Row(24, agreement, values, "among_contacts")


def _down_below(both: _Both, post_m: float) -> float:
    """Return the share of frames below the post section with all feet down."""
    below = _heights(both.recording).body < post_m
    return float(both.truth.foot_down[below].all(axis=1).mean())


def _landings_inside(both: _Both, found: Study) -> float:
    """Return the share of true landings whose contacts lie between the sections."""
    inside = _inside(both, found.touchdowns)
    return float(inside.sum() / both.truth.complete.sum())


def _inside(both: _Both, table: pd.DataFrame) -> BoolArray:
    """Mark the touchdowns (m,) whose true contacts lie in their transition."""
    true = _true_contacts(both, _instants(both, table))
    begin_s = table["t_pre_s"].to_numpy(float)
    end_s = table["t_post_s"].to_numpy(float)
    first = true.min(axis=1) >= begin_s
    return np.asarray(first & (true.max(axis=1) <= end_s))


def _section_figure(both: _Both) -> Row:
    """Item 25: Fig. 2.2 by both methods."""
    heights = _heights(both.recording)
    values = {
        "frames": int(heights.seen.sum()),
        "printed_pre": 1e3 * both.printed.sections.pre_height_m,
        "printed_post": 1e3 * both.printed.sections.post_height_m,
        "pre": 1e3 * both.ours.sections.pre_height_m,
        "post": 1e3 * both.ours.sections.post_height_m,
    }
    ordered = all(
        one.sections.pre_height_m > one.sections.post_height_m
        for one in (both.printed, both.ours)
    )
    return Row(25, _built(ordered), values)


# The labels.


def _instants(both: _Both, table: pd.DataFrame) -> FloatArray:
    """Return the contacts of a table of touchdowns, (m, n), s."""
    feet = both.recording.names("foot")
    return table[[f"contact_{foot}_s" for foot in feet]].to_numpy(float)


def _true_contacts(both: _Both, instants: FloatArray) -> FloatArray:
    """Return the true contacts of the nearest landings, (m, n); NaN without one."""
    from hopdata.maps.truth.scoring import match_landings

    true = both.truth.contact_times[both.truth.complete]
    landing = match_landings(instants, true)
    found = np.full(instants.shape, np.nan)
    found[landing >= 0] = true[landing[landing >= 0]]
    return found


@dataclass(frozen=True)
class _Score:
    """Share of right orders and of ties, in per cent; bias and deviation, ms."""

    right: float
    ties: float
    bias: float
    deviation: float


def _scored(both: _Both, instants: FloatArray) -> _Score:
    """Score contacts (m, n), s, against the truth."""
    from hopdata.landings.schedules import schedule_names

    true = _true_contacts(both, instants)
    labels = np.array(schedule_names(instants), dtype=str)
    known = np.array(schedule_names(true), dtype=str)
    right = (labels == known) & (known != "")
    ordered = np.sort(instants, axis=1)
    ties = (np.diff(ordered, axis=1) < 1e-9).any(axis=1)
    errors_ms = 1e3 * (instants - true)
    errors_ms = errors_ms[np.isfinite(errors_ms)]
    return _Score(
        right=100 * float(right.mean()),
        ties=100 * float(ties.mean()),
        bias=float(errors_ms.mean()),
        deviation=float(errors_ms.std()),
    )


def _used(table: pd.DataFrame) -> pd.DataFrame:
    return table[~table["excluded"].astype(bool)]


def _velocity_minimum(both: _Both) -> Row:
    """Item 26: the printed label, beside the order by the feet's heights."""
    from hopdata.landings.touchdowns import touchdown_table

    (contacts,) = both.printed.contacts.values()
    sections = both.ours.sections
    at_ours = touchdown_table(
        both.recording,
        pre_height_m=sections.pre_height_m,
        post_height_m=sections.post_height_m,
        landings=contacts,
        method="velocity_minimum",
    )
    used = _used(both.printed.touchdowns)
    threshold_m = both.printed.sections.max_foot_threshold_m
    (uneven,) = both.printed.imported
    printed = _scored(both, _instants(both, used))
    elsewhere = _scored(both, _instants(both, _used(at_ours)))
    level = _scored(both, _first_below(both.recording, used, threshold_m))
    raw = _scored(both, _first_below(uneven, used, threshold_m))
    kink = _scored(both, _instants(both, _used(both.ours.touchdowns)))
    values = {
        "right": printed.right,
        "ties": printed.ties,
        "bias": -printed.bias,
        "deviation": printed.deviation,
        "at_ours": elsewhere.right,
        "by_height": level.right,
        "by_raw_height": raw.right,
        "kink": kink.right,
    }
    agreement = Agreement.DIFFERS
    if is_higher(printed.right, raw.right, len(used)):
        better = is_higher(printed.right, level.right, len(used))
        agreement = _agrees(better, Agreement.PARTLY)
    return Row(26, agreement, values, "whole_frames")


def is_higher(percent: float, other: float, number: int) -> bool:
    """Tell whether one share is higher than another by two standard errors."""
    shares = np.array([percent, other]) / 100
    error = np.sqrt((shares * (1 - shares)).sum() / number)
    return bool(shares[0] - shares[1] > 2 * error)


def _first_below(
    recording: Recording, table: pd.DataFrame, threshold_m: float
) -> FloatArray:
    """Return the first frame of each transition with the foot down, (m, n), s.

    A foot is down below the threshold; NaN where it never is.
    """
    heights = recording.feet[:, :, 2]
    found = np.full((len(table), heights.shape[1]), np.nan)
    spans = table[["t_pre_s", "t_post_s"]].to_numpy(float)
    first, stop = np.searchsorted(recording.time, spans).T
    for row, (begin, end) in enumerate(zip(first, stop, strict=True)):
        # A foot may come down a little later than the section.
        after = slice(begin, 2 * end - begin)
        down = heights[after] < threshold_m
        landed = down.any(axis=0)
        found[row, landed] = recording.time[begin + down.argmax(axis=0)[landed]]
    return found


def _default_labels(both: _Both) -> Row:
    """Item 27: the order of the contacts decides the class of a touchdown."""
    printed = _scored(both, _instants(both, _used(both.printed.touchdowns)))
    kink = _scored(both, _instants(both, _used(both.ours.touchdowns)))
    n_true = int(both.truth.complete.sum())
    n_used = len(_used(both.ours.touchdowns))
    values = {
        "printed_right": printed.right,
        "right": kink.right,
        "bias": kink.bias,
        "deviation": kink.deviation,
        "used": n_used,
        "landings": n_true,
        "schedules": _used(both.ours.touchdowns)["schedule"].nunique(),
        "printed_schedules": _used(both.printed.touchdowns)["schedule"].nunique(),
    }
    return Row(27, Agreement.BUILT, values, "frames")


def _excluded(both: _Both) -> Row:
    """Item 28: touchdowns with a foot outside the transition."""
    values: dict[str, Any] = {"landings": int(both.truth.complete.sum())}
    for name, found in (("printed", both.printed), ("ours", both.ours)):
        table = found.touchdowns
        used = _used(table)
        inside = _inside(both, used)
        values[f"{name}_excluded"] = len(table) - len(used)
        values[f"{name}_used"] = len(used)
        values[f"{name}_outside"] = int((~inside).sum())
    # The minimum leads the contact, so contacts beyond the post section pass as inside.
    all_excluded = (
        values["printed_outside"] <= (1 - NEARLY_ALL) * values["printed_used"]
    )
    agreement = Agreement.DIFFERS
    if values["printed_outside"] < values["printed_excluded"]:
        agreement = _agrees(all_excluded, Agreement.PARTLY)
    return Row(28, agreement, values, "lead")


def _schedule_figure(both: _Both) -> Row:
    """Item 29: the plus of each foot, and the minimum of its velocity."""
    values: dict[str, Any] = {}
    examples = _examples(both)
    for name in ("printed", "ours"):
        example = examples[f"{name}_example"]
        shown = examples[f"{name}_touchdown"].iloc[0]
        values[name] = _above_minimum(example, shown)
        values[f"{name}_order"] = str(shown["schedule"]).replace(">", ", ")
    on_minima = values["printed"] < 1e-9 < values["ours"]
    return Row(29, _built(on_minima), values, "kink")


def _above_minimum(example: pd.DataFrame, touchdown: pd.Series) -> float:
    """Return how far above its smallest velocity a foot's plus lies at most, m/s."""
    end_s = float(touchdown["t_post_s"] - touchdown["t_pre_s"])
    most = 0.0
    for foot, rows in example.groupby("foot", sort=False):
        time = rows["time_s"].to_numpy(float)
        velocity = rows["velocity_m_s"].to_numpy(float)
        instant = float(touchdown[f"contact_{foot}_s"] - touchdown["t_pre_s"])
        inside = (time >= 0) & (time <= end_s)
        at_plus = float(np.interp(instant, time, velocity))
        most = max(most, at_plus - float(velocity[inside].min()))
    return most


def _examples(both: _Both) -> dict[str, pd.DataFrame]:
    """Return one landing by both methods: its samples, and its row of touchdowns."""
    from hopdata.landings.contacts.velocity_minimum import example_touchdown

    recordings = [both.recording]
    printed = both.printed.touchdowns
    example = example_touchdown(recordings, printed)
    shown = printed[printed["touchdown"] == example["touchdown"].iloc[0]]
    ours = _used(both.ours.touchdowns)
    nearest = (ours["t_pre_s"] - float(shown["t_pre_s"].iloc[0])).abs().idxmin()
    same = ours.loc[[nearest]]
    return {
        "printed_example": example,
        "printed_touchdown": shown,
        "ours_example": example_touchdown(recordings, same),
        "ours_touchdown": same,
    }


# Home frame and units.


def _home_frame(both: _Both, seeds: Sequence[int]) -> Row:
    """Item 30: states do not change if the plane is shifted and turned."""
    from hopdata.landings.states.home_frames import home_frames

    recording = both.recording
    table = _used(both.ours.touchdowns)
    spans = (table["t_pre_s"].to_numpy(float), table["t_post_s"].to_numpy(float))
    names = recording.names("body")
    marker = names.index(both.ours.config["home"]["marker"])
    frames = np.searchsorted(recording.time, spans[0])

    def states(body: FloatArray) -> FloatArray:
        found = home_frames(recording.time, body, *spans, marker=marker)
        return found.points(body[frames])

    usual = states(recording.body)
    changes = []
    for seed in seeds:
        rng = np.random.default_rng(np.random.SeedSequence((seed, 2)))
        angle = rng.uniform(0, 2 * np.pi)
        turn = np.array(
            [[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]
        )
        moved = recording.body.copy()
        moved[..., :2] = moved[..., :2] @ turn + rng.uniform(-10, 10, 2)
        changes.append(float(np.nanmax(np.abs(states(moved) - usual))))
    values = {"change": changes, "touchdowns": len(table)}
    return Row(30, _built(max(changes) < 1e-9), values)


def _units(both: _Both) -> Row:
    """Item 31: units of length and time, and whether the text's own agree."""
    ours = both.ours.units
    printed = both.printed.units
    speed = LENGTH_M / TIME_S
    values = {
        "text_speed": speed,
        "text_position": WORST_POSITION_M / LENGTH_M,
        "text_velocity": WORST_VELOCITY_M_S / speed,
        "printed_length": 1e3 * printed["length_unit_m"],
        "printed_time": 1e3 * printed["time_unit_s"],
        "printed_speed": printed["length_unit_m"] / printed["time_unit_s"],
        "length": 1e3 * ours["length_unit_m"],
        "time": 1e3 * ours["time_unit_s"],
        "speed": ours["length_unit_m"] / ours["time_unit_s"],
    }
    consistent = _close(values["text_velocity"], values["text_position"])
    same = _close(printed["length_unit_m"], LENGTH_M) and _close(
        printed["time_unit_s"], TIME_S
    )
    agreement = Agreement.DIFFERS
    if consistent:
        agreement = _agrees(same, Agreement.PARTLY)
    return Row(31, agreement, values, "another_body")


# Tables of the figures.


def _tables(both: _Both) -> dict[str, pd.DataFrame]:
    """Return what the figures draw, by both methods."""
    from hopdata.landings.sections import select

    tables = {}
    rows = []
    for name, found in (("printed", both.printed), ("ours", both.ours)):
        sections = found.sections
        recordings = found.recordings
        tables[f"{name}_densities"] = select.section_densities(
            recordings, sections, found.contacts
        )
        tables[f"{name}_frames"] = select.section_frames(
            recordings, sections, max_rows=SHOWN_FRAMES
        )
        rows.append(
            {
                "method": name,
                "rule": sections.rule,
                "frames": sections.frames,
                "pre_height_m": sections.pre_height_m,
                "post_height_m": sections.post_height_m,
                "min_foot_threshold_m": sections.min_foot_threshold_m,
                "max_foot_threshold_m": sections.max_foot_threshold_m,
            }
        )
    tables["sections"] = pd.DataFrame(rows)
    return tables | _examples(both)
