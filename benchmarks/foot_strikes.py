"""Published foot-strike detectors beside the kink fit: a runner on forces, and known contacts.

    python benchmarks/foot_strikes.py --out foot_strikes.csv [--seeds 5] [--landings
    300]

Each detector follows the formula of its paper, on the same landings and in the same
windows. The papers leave the cutoff of the low-pass filter (fourth order, zero lag) to
the user. Each of `CUTOFFS_HZ` is tried and the one with the least `sd_ms` is reported,
so that the filter puts no peer at a disadvantage.

- printed: the frame of least vertical velocity (the dissertation, Sec. 2.2.3), and a
  parabola through it.
- foot velocity algorithm: trough of the vertical velocity while the foot is in the
  lowest 35 % of its rise; for the runner, of the point between heel and metatarsals;
  O'Connor et al. 2007, Gait & Posture 25:469, doi 10.1016/j.gaitpost.2006.05.016.
- vertical acceleration peak, where the jerk is zero, linearly interpolated between
  frames; Hreljac and Marshall 2000, J. Biomech. 33:783, doi
  10.1016/S0021-9290(00)00014-2.
- farthest ahead of the sacrum; Zeni et al. 2008, Gait & Posture 27:710, doi
  10.1016/j.gaitpost.2007.07.007. Feet that fall straight down have no such place.
- change of the vertical velocity from down to up; Fellin et al. 2010, J. Sci. Med.
  Sport 13:646, doi 10.1016/j.jsams.2010.03.006.

Jumps are those of `jumps.py`: a drop from a box and a rebound, in eleven trials of two
landings for each seed; the toes of both feet, at rates of 100 to 250 Hz. The published
detectors are told where to look: within `AROUND_S` of the true contacts, with gaps
bridged by straight lines. hopdata has the files only (`hopdata.contacts`).

Simulated feet are those of `contact_instants.py`: medians over the seeds, and the worst
seed. For the runner, the first contact of a foot's three markers is compared with the
onset of force (the papers use the heel's contact, which is the last in this runner).
`sd_ms` comes from the median absolute deviation. `sd_own_ms` is the same without the
error of the onsets, `sd_force_ms`, which is measured from the two halves of the force
samples.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jumps
import numpy as np
import pandas as pd
from contact_instants import (
    CONDITIONS,
    FOLDERS,
    FORCE_HZ,
    FORCES,
    MARKERS,
    SECTIONS,
    SIDES,
    _foot,
    make,
    ours,
)
from scipy.signal import butter, sosfiltfilt

from hopdata.arrays import FloatArray
from hopdata.contact_times import contacts as contacts_of
from hopdata.landings.forces import force_onsets
from hopdata.landings.touchdowns import NO_FOOT_LANDED, touchdown_table
from hopdata.recording import Recording

CUTOFFS_HZ = (7.0, 12.0, 20.0, 35.0)
SAME_S = 0.15  # instants farther apart do not belong to the same contact, s
LOW = 0.35  # "low" is this fraction of a foot's rise
AROUND_S = 0.1  # frames before and after a landing that a detector sees, s
EARLY_S = (
    0.25  # before a runner's landing, s: a foot is farthest ahead long before it lands
)
SIMULATED = (
    "hard, N(0, 10 ms)",
    "soft and creep",
    "three frames missing at each contact",
)
JUMPS = {
    "drop jumps": "box",
    "drop jumps, soft 8 ms": "box, soft 8 ms",
}
TRIALS = 11  # of a drop and a rebound, for each seed
TOES = ("LTOE", "RTOE")
JUMP_RATES_HZ = (100.0, 120.0, 200.0, 250.0)
JUMP_NOISES_M = (3e-4, 1e-3)
#: Detects instants, s, in windows (..., W) of heights and of positions ahead of the
#: sacrum, m.
Detector = Callable[[FloatArray, FloatArray, FloatArray | None], FloatArray]


def _at(values: FloatArray, frame: FloatArray) -> FloatArray:
    return np.take_along_axis(values, frame[..., None], axis=-1)[..., 0]


def _zero(t: FloatArray, values: FloatArray, frame: FloatArray) -> FloatArray:
    """Return where the line from a frame to the next crosses zero."""
    a, b = _at(values, frame), _at(values, frame + 1)
    first, after = _at(t, frame), _at(t, frame + 1)
    return first + (after - first) * a / np.where(a == b, 1.0, a - b)


def _slope(values: FloatArray, t: FloatArray) -> FloatArray:
    return np.gradient(values, axis=-1) / (t[..., 1] - t[..., 0])[..., None]


def foot_velocity(t: FloatArray, z: FloatArray, ahead: FloatArray | None) -> FloatArray:
    """Return the trough of the vertical velocity while the foot is low."""
    del ahead
    low = z <= (z.min(axis=-1) + LOW * np.ptp(z, axis=-1))[..., None]
    return _at(t, np.argmin(np.where(low, _slope(z, t), np.inf), axis=-1))


def acceleration_peak(
    t: FloatArray, z: FloatArray, ahead: FloatArray | None
) -> FloatArray:
    """Return the instant of greatest vertical acceleration, where the jerk is zero."""
    del ahead
    acceleration = _slope(_slope(z, t), t)
    peak = np.argmax(acceleration[..., 2:-3], axis=-1) + 2
    jerk = _slope(acceleration, t)
    return _zero(t, jerk, np.where(_at(jerk, peak) > 0, peak, peak - 1))


def farthest_ahead(
    t: FloatArray, z: FloatArray, ahead: FloatArray | None
) -> FloatArray:
    """Return the frame in which the foot is farthest ahead of the sacrum."""
    return (
        np.full(z.shape[:-1], np.nan)
        if ahead is None
        else _at(t, np.argmax(ahead, axis=-1))
    )


def velocity_crossing(
    t: FloatArray, z: FloatArray, ahead: FloatArray | None
) -> FloatArray:
    """Return the first change of the vertical velocity from down to up after its trough."""
    del ahead
    velocity = _slope(z, t)
    place = np.arange(z.shape[-1] - 1)
    after = place >= np.argmin(velocity, axis=-1)[..., None]
    turns = after & (velocity[..., :-1] < 0) & (velocity[..., 1:] >= 0)
    found = _zero(t, velocity, np.argmax(turns, axis=-1))
    return np.where(turns.any(axis=-1), found, np.nan)


PUBLISHED: dict[str, Detector] = {
    "foot velocity algorithm (O'Connor 2007)": foot_velocity,
    "acceleration peak (Hreljac 2000)": acceleration_peak,
    "ahead of the sacrum (Zeni 2008)": farthest_ahead,
    "velocity crossing (Fellin 2010)": velocity_crossing,
}
OURS = {
    "printed, whole frame": "velocity_minimum",
    "printed, parabola": "velocity_minimum_parabola",
    "kink (hopdata)": "kink",
}


def smooth(
    values: FloatArray, rate_hz: float, cutoff_hz: float, axis: int
) -> FloatArray:
    """Apply the papers' low-pass filter: Butterworth, forward and backward, fourth order in all."""
    return np.asarray(
        sosfiltfilt(butter(2, cutoff_hz, fs=rate_hz, output="sos"), values, axis=axis)
    )


def simulated_rows(name: str, arguments: argparse.Namespace) -> list[dict[str, Any]]:
    """Return one row for each method in one condition."""
    runs: dict[tuple[str, float], list[dict[str, float]]] = {}
    seeds = np.random.SeedSequence([arguments.seed, 26, SIMULATED.index(name)])
    for seed in seeds.spawn(arguments.seeds):
        landings = make(
            arguments.landings, CONDITIONS[name], np.random.default_rng(seed)
        )
        whole = landings.filled() if CONDITIONS[name].missing_frames else landings
        for label, method in OURS.items():
            instant, _ = ours(landings if method == "kink" else whole, method=method)
            runs.setdefault((label, np.nan), []).append(
                _scored(instant, landings.contacts)
            )
        count, feet = landings.contacts.shape
        z = whole.heights.reshape(count, -1, feet).transpose(0, 2, 1)
        t = np.broadcast_to(whole.time.reshape(count, 1, -1), z.shape)
        rate_hz = 1.0 / (whole.time[1] - whole.time[0])
        near = np.abs(t[:, 0] - landings.transitions.t_pre[:, None] - 0.035).argmin(
            axis=1
        )
        frames = near[:, None] + np.arange(
            -round(AROUND_S * rate_hz), round(AROUND_S * rate_hz)
        )
        for cutoff_hz in CUTOFFS_HZ:
            smoothed = smooth(z, rate_hz, cutoff_hz, axis=-1)
            seen = [
                np.take_along_axis(x, frames[:, None, :], axis=-1)
                for x in (t, smoothed)
            ]
            for label, detect in PUBLISHED.items():
                found = _scored(detect(seen[0], seen[1], None), landings.contacts)
                runs.setdefault((label, cutoff_hz), []).append(found)
    rows = []
    for (label, cutoff_hz), results in runs.items():
        table = pd.DataFrame(results)
        row = {"condition": name, "method": label, "cutoff_hz": cutoff_hz}
        row |= {
            "seeds": arguments.seeds,
            "landings": arguments.landings,
            **table.median().to_dict(),
        }
        row |= {
            "sd_ms_worst": table["sd_ms"].max(),
            "order_right_worst": table["order_right"].min(),
        }
        rows.append(row)
    return rows


def jump_rows(name: str, arguments: argparse.Namespace) -> list[dict[str, Any]]:
    """Return one row for each method on drop jumps; a seed is a session of trials."""
    runs: dict[tuple[str, float], list[dict[str, float]]] = {}
    seeds = np.random.SeedSequence([arguments.seed, 27, [*JUMPS].index(name)])
    for number, seed in enumerate(seeds.spawn(arguments.seeds)):
        rng = np.random.default_rng(seed)
        rate_hz = JUMP_RATES_HZ[number % len(JUMP_RATES_HZ)]
        noise_m = rng.uniform(*JUMP_NOISES_M)
        kind = jumps.KINDS[JUMPS[name]]
        trials = [jumps.make(kind, 2, rng, rate_hz, noise_m) for _ in range(TRIALS)]
        truth = [np.column_stack([at[toe] for toe in TOES]) for _, at in trials]
        every_truth = np.concatenate(truth)
        recordings = [
            _jump(f"trial{k + 1}", positions, rate_hz)
            for k, (positions, _) in enumerate(trials)
        ]
        for label, method in OURS.items():
            found = contacts_of(recordings, method=method).found
            near = [
                _nearest(found[found["recording"] == one.name], at)
                for one, at in zip(recordings, truth, strict=True)
            ]
            run = _scored_pairs(np.concatenate(near), every_truth)
            runs.setdefault((label, np.nan), []).append(run)
        for cutoff_hz in CUTOFFS_HZ:
            for label, detect in PUBLISHED.items():
                if detect is farthest_ahead:  # these feet fall straight down
                    continue
                found_at = [
                    _told_where(one, at, detect, cutoff_hz)
                    for one, at in zip(recordings, truth, strict=True)
                ]
                run = _scored_pairs(np.concatenate(found_at), every_truth)
                runs.setdefault((label, cutoff_hz), []).append(run)
    rows = []
    for (label, cutoff_hz), results in runs.items():
        table = pd.DataFrame(results)
        row = {"condition": name, "method": label, "cutoff_hz": cutoff_hz}
        row |= {"seeds": arguments.seeds, "landings": 2 * TRIALS}
        row |= table.median().to_dict()
        row |= {
            "found_worst": table["found"].min(),
            "sd_ms_worst": table["sd_ms"].max(),
            "order_right_worst": table["order_right"].min(),
        }
        rows.append(row)
    return rows


def _jump(name: str, positions: FloatArray, rate_hz: float) -> Recording:
    time = np.arange(len(positions)) / rate_hz
    return Recording.from_arrays(
        time, positions, jumps.NAMES, feet=TOES, body=jumps.PELVIS, name=name
    )


def _nearest(found: pd.DataFrame, truth: FloatArray) -> FloatArray:
    """Return the contacts found nearest to the true ones (L, 2), s; NaN for none."""
    nearest = np.full(truth.shape, np.nan)
    for foot, name in enumerate(TOES):
        own = found.loc[found["foot"] == name, "contact_s"].to_numpy()
        if len(own):
            away = np.abs(own[:, None] - truth[:, foot])
            nearest[:, foot] = own[away.argmin(axis=0)]
    return nearest


def _told_where(
    recording: Recording, truth: FloatArray, detect: Detector, cutoff_hz: float
) -> FloatArray:
    """Return the instants (L, 2), s, of a detector that sees only the landings."""
    rate_hz = recording.rate_hz
    if detect is foot_velocity:  # uses the point between heel and toe
        heels = [jumps.NAMES.index(toe.replace("TOE", "HEE")) for toe in TOES]
        toes = [jumps.NAMES.index(toe) for toe in TOES]
        z = recording.positions[:, [toes, heels], 2].mean(axis=1)
    else:
        z = recording.feet[:, :, 2].copy()
    for column in z.T:
        seen = np.isfinite(column)
        column[~seen] = np.interp(
            recording.time[~seen], recording.time[seen], column[seen]
        )
    z = smooth(z, rate_hz, min(cutoff_hz, 0.45 * rate_hz), axis=0)
    reach = np.arange(-round(AROUND_S * rate_hz), round(AROUND_S * rate_hz))
    frames = np.round(truth * rate_hz).astype(int)[:, :, None] + reach
    frames = frames.clip(0, len(z) - 1)
    windows = z[frames, np.arange(len(TOES))[:, None]]
    return detect(recording.time[frames], windows, None)


def _scored_pairs(instant: FloatArray, truth: FloatArray) -> dict[str, float]:
    """Score instants as `_scored`, and the differences of left and right."""
    scored = _scored(instant, truth)
    error_ms = 1e3 * (instant - truth)
    near = (np.abs(error_ms) < 1e3 * SAME_S).all(axis=1)
    apart_ms = (error_ms[:, 0] - error_ms[:, 1])[near]
    scored["sd_apart_ms"] = float(apart_ms.std()) if len(apart_ms) else np.nan
    return scored


def _scored(instant: FloatArray, truth: FloatArray) -> dict[str, float]:
    """Score instants (L, feet) against the true ones; ignore those off by more than `SAME_S`."""
    instant = np.where(np.abs(instant - truth) < SAME_S, instant, np.nan)
    whole = np.isfinite(instant).all(axis=1)
    if not whole.any():
        return {"found": 0.0, "bias_ms": np.nan, "sd_ms": np.nan, "order_right": np.nan}
    error_ms = 1e3 * (instant - truth)[whole]
    order, right = (np.argsort(x[whole], axis=1) for x in (instant, truth))
    return {
        "found": float(whole.mean()),
        "bias_ms": float(error_ms.mean()),
        "sd_ms": float(error_ms.std()),
        "order_right": float((order == right).all(axis=1).mean()),
    }


def runner_rows() -> list[dict[str, Any]]:
    """Return one row for each foot and method, or one that says the files are absent."""
    folder = next(
        (f for f in FOLDERS if (f / MARKERS).is_file() and (f / FORCES).is_file()), None
    )
    if folder is None:
        return [
            {
                "condition": "runner against force",
                "method": "absent: no files of the runner",
            }
        ]
    force = pd.read_csv(folder / FORCES, sep="\t")["Fy"].to_numpy(
        float
    )  # upwards in this file
    clock = np.arange(len(force)) / FORCE_HZ
    onsets = force_onsets(clock, force)
    halves = [force_onsets(clock[k::2], force[k::2]) for k in (0, 1)]
    apart = halves[0] - halves[1][np.abs(halves[0][:, None] - halves[1]).argmin(axis=1)]
    # The difference of the halves has sqrt(2) times the error of one half. All samples
    # together are twice as dense, which halves the error again.
    own_ms = 1e3 * _scatter(apart[np.abs(apart) < SAME_S]) / np.sqrt(2) / 2
    rows = []
    for side, (turn, name) in SIDES.items():
        recording = _foot(folder / MARKERS, side)
        condition = {"condition": f"runner's {name} foot against force"}
        for label, method in OURS.items():
            table = touchdown_table(recording, **SECTIONS, method=method)
            contacts = table[
                [column for column in table if column.startswith("contact_")]
            ]
            first = contacts.min(axis=1).to_numpy()
            rows.append(
                condition
                | {"method": label}
                | _compared(first, onsets[turn::2], own_ms)
            )
        table = touchdown_table(recording, **SECTIONS)
        spans = table.loc[
            table["reason"] != NO_FOOT_LANDED, ["t_pre_s", "t_post_s"]
        ].dropna()
        middle = spans.mean(axis=1).to_numpy()
        for cutoff_hz in CUTOFFS_HZ:
            for label, detect in PUBLISHED.items():
                early_s = EARLY_S if detect is farthest_ahead else AROUND_S
                t, z, ahead = _runner_windows(recording, middle, cutoff_hz, early_s)
                if detect is foot_velocity:  # uses the point between heel and toe
                    t, z = (
                        t[:, :1],
                        0.5 * (z[:, :1] + z[:, 1:].mean(axis=1, keepdims=True)),
                    )
                first = np.fmin.reduce(detect(t, z, ahead), axis=1)
                found = _compared(first, onsets[turn::2], own_ms)
                rows.append(
                    condition | {"method": label, "cutoff_hz": cutoff_hz} | found
                )
    return rows


def _runner_windows(
    recording: Recording, middle: FloatArray, cutoff_hz: float, early_s: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return times, heights and positions ahead of the pelvis about the landings, (L, feet, W)."""
    rate_hz, feet = recording.rate_hz, recording.feet
    reach = np.arange(-round(early_s * rate_hz), round(AROUND_S * rate_hz))
    frames = np.round(middle * rate_hz).astype(int)[:, None] + reach
    frames = frames[(frames[:, 0] >= 0) & (frames[:, -1] < len(recording.time))]
    axis = int(np.argmax(np.ptp(feet[:, 0, :2], axis=0)))  # along the belt
    highest = feet[:, :, 2].max(axis=1)
    stands = highest[1:] < np.quantile(highest, 0.2)
    forward = -np.sign(np.median(np.diff(feet[:, 0, axis])[stands]))
    pelvis = recording.body.mean(axis=1)[:, axis]
    seen = np.isfinite(pelvis)
    pelvis = np.interp(recording.time, recording.time[seen], pelvis[seen])
    ahead = forward * (feet[:, :, axis] - pelvis[:, None])
    z, ahead = (smooth(x, rate_hz, cutoff_hz, axis=0) for x in (feet[:, :, 2], ahead))
    windows = [x[frames].transpose(0, 2, 1) for x in (z, ahead)]
    t = np.broadcast_to(recording.time[frames][:, None, :], windows[0].shape)
    return t, *windows


def _scatter(values: FloatArray) -> float:
    """Return the standard deviation estimated from the median absolute deviation."""
    return 1.4826 * float(np.median(np.abs(values - np.median(values))))


def _compared(first: FloatArray, onsets: FloatArray, own_ms: float) -> dict[str, float]:
    """Compare first contacts with the onsets of force; descents of the other leg do not count."""
    first = first[np.isfinite(first)]
    away = np.abs(first[:, None] - onsets)
    late_ms = 1e3 * (first - onsets[away.argmin(axis=1)])[away.min(axis=1) < SAME_S]
    middle = float(np.median(late_ms)) if len(late_ms) else np.nan
    sd_ms = _scatter(late_ms) if len(late_ms) else np.nan
    return {
        "landings": len(onsets),
        "found": float((away.min(axis=0) < SAME_S).mean()) if len(first) else 0.0,
        "bias_ms": middle,
        "sd_ms": sd_ms,
        "sd_force_ms": own_ms,
        "sd_own_ms": float(np.sqrt(max(sd_ms**2 - own_ms**2, 0.0))),
    }


COLUMNS = (
    *(
        "condition",
        "method",
        "cutoff_hz",
        "seeds",
        "landings",
        "found",
        "bias_ms",
        "sd_ms",
    ),
    *("sd_ms_worst", "sd_force_ms", "sd_own_ms", "order_right", "order_right_worst"),
    *("found_worst", "sd_apart_ms"),
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="CSV file to write")
    parser.add_argument(
        "--seeds", type=int, default=5, help="simulated recordings (default 5)"
    )
    parser.add_argument("--landings", type=int, default=300, help="landings of each")
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    rows = [
        *(row for name in SIMULATED for row in simulated_rows(name, arguments)),
        *(row for name in JUMPS for row in jump_rows(name, arguments)),
        *runner_rows(),
    ]
    table = pd.DataFrame(rows).reindex(columns=COLUMNS)
    found = table["found"].fillna(0.0) >= 0.5 * table.groupby("condition")[
        "found"
    ].transform("max")
    order = table.assign(enough=~found).sort_values(["enough", "sd_ms"], kind="stable")
    best = (
        order.drop_duplicates(["condition", "method"])
        .drop(columns="enough")
        .sort_index()
    )
    places = {label: place for place, label in enumerate((*OURS, *PUBLISHED))}
    best = best.sort_values("method", key=lambda x: x.map(places), kind="stable")
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    best.to_csv(arguments.out, index=False, float_format="%.4g")
    print(best.round(3).to_string(index=False))


if __name__ == "__main__":
    main()
