"""The drawings of chapters II and III, and what the drawn things do.

The robot is drawn from its scene (Figs. 2.1, 3.1, 3.2), the board from a run that
pushes it (Fig. 3.7), the loop from its declaration (Fig. 3.4), which a drive confirms.
"""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from hopdata.arrays import pd
from hopdata.dissertation.rows import Agreement, Made, Row
from hopdata.figures.robot import robot_figure
from hopdata.scenes.hopper_parameters import HopperParameters
from hopdata.steering import robot as plant
from hopdata.steering import turning
from hopdata.steering.experiments.tasks import Unheeding
from hopdata.steering.figures.drawings import board_figure, loop_figure
from hopdata.steering.live import parts as live_parts
from hopdata.steering.live.buffer import Stream
from hopdata.steering.live.drive import Drive, drive
from hopdata.steering.live.loop import ControlLoop
from hopdata.steering.live.simulated import LiveHopper, SimulatedBoom, SimulatedStream
from hopdata.steering.loaded_stances import noticed_stances
from hopdata.steering.observation.calibration import calibrate
from hopdata.steering.observation.geometry import HopperGeometry
from hopdata.steering.robot import LIGHT_BOOM
from hopdata.steering.trial import record_trial
from hopdata.synthesis.sketch import (
    BODY_MARKER,
    COUNTERWEIGHT,
    FOOT,
    POINT,
    hopper_sketch,
    leg_forces,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Effort:
    """How much is computed: a test asks for less than the page.

    Parameters
    ----------
    calibration_hops, noticed_hops, fall_hops : int
        Hops to calibrate from, of which the stances are noticed, and for each size of
        the swings.
    drive_s : float
        Duration of the drive, s of real time.
    """

    calibration_hops: int = 40
    noticed_hops: int = 100
    fall_hops: int = 40
    drive_s: float = 4.0


PRINTED_LIMIT_DEG = 90.0  # Sec. 3.3

#: Swings whose falls are counted; the last is beyond the printed limit.
#: Unit: degrees. Origin: chosen.
FALL_SWINGS_DEG = (45.0, 67.5, 90.0, 135.0)
#: Counterweight of the steered hopper; `HEAVY_KG` is that of the study's.
#: Unit: kg. Origin: derived: the defaults of `SteeredHopper` and `HopperParameters`.
LIGHT_KG = LIGHT_BOOM.counterweight_mass_kg
#: See `LIGHT_KG`.
#: Unit: kg. Origin: derived: see `LIGHT_KG`.
HEAVY_KG = HopperParameters().counterweight_mass_kg
#: Hops into the board.
#: Unit: 1. Origin: chosen.
BOARD_HOPS = 16
#: Swing to and fro that takes the hopper ahead into the board.
#: Unit: rad. Origin: chosen.
BOARD_SWING_RAD = 0.4
#: Largest difference between forces, or places, that are the same.
#: Unit: N and mm. Origin: rounding: far above it, far below anything that matters.
EXACT = 1e-9


def make(seeds: Sequence[int], *, effort: Effort | None = None) -> Made:
    """Measure items 14, 51, 52, 53, 71 and 74."""
    effort = effort or Effort()
    robot = plant.SteeredHopper()
    study = HopperParameters()
    recording = record_trial(
        robot, _to_and_fro(effort.calibration_hops), seed=int(seeds[0])
    ).recording
    geometry = calibrate(recording)
    tables = {
        "study_sketch": hopper_sketch(study),
        "study_forces": leg_forces(study),
        "steered_sketch": hopper_sketch(
            robot.hopper, robot.markers, swing_limit_rad=robot.swing_limit_rad
        ),
        "steered_forces": leg_forces(robot.hopper),
        "board": pushed_board(robot, int(seeds[0])),
        "parts": pd.DataFrame([asdict(part) for part in live_parts.PARTS]),
        "flows": pd.DataFrame([asdict(flow) for flow in live_parts.FLOWS]),
        "delays": _delays(robot, geometry, seeds, effort),
        "falls": _falls(robot, seeds, effort),
    }
    alive, driven = threads_of_a_drive(robot, geometry, effort.drive_s)
    rows = [
        preload_row(study, tables),
        robot_row(robot, tables),
        stance_row(tables["delays"]),
        limit_row(robot, tables["falls"]),
        loop_row(alive, driven),
        board_row(tables["board"]),
    ]
    return Made(rows, tables)


def draw(tables: Mapping[str, pd.DataFrame]) -> Mapping[str, Figure]:
    """Draw the part's figures."""
    return {
        "fig2_1_robot": robot_figure(
            tables["study_sketch"],
            tables["study_forces"],
            panels=("assembly", "leg"),
        ),
        "fig3_1_robot": robot_figure(
            tables["steered_sketch"], tables["steered_forces"]
        ),
        "fig3_4_loop": loop_figure(tables["parts"], tables["flows"]),
        "fig3_7_board": board_figure(tables["steered_sketch"], tables["board"]),
    }


def _to_and_fro(hops: int) -> list[float]:
    """Return swings that move the boom around: three one way, two back, and so on."""
    pattern = [0.9, 0.9, 0.9, -0.9, -0.9]
    return [pattern[k % len(pattern)] for k in range(hops)]


# Items 14 and 51: the robot.


def preload_row(study: HopperParameters, tables: Mapping[str, pd.DataFrame]) -> Row:
    """Judge item 14: the force of a leg jumps to its preload, and is affine."""
    forces = tables["study_forces"]
    landing = forces[forces["phase"] == "landing"]
    line = np.polyfit(landing["gap_m"], landing["force_n"], 1)
    bent_n = np.abs(np.polyval(line, landing["gap_m"]) - landing["force_n"]).max()
    at_touchdown_n = float(landing["force_n"].iloc[0])
    sketch = tables["study_sketch"]
    is_preloaded = abs(at_touchdown_n - study.preload_n) < EXACT and at_touchdown_n > 0
    agreement = Agreement.DIFFERS
    if is_preloaded and bent_n < EXACT:
        agreement = Agreement.BUILT
    return Row(
        item=14,
        agreement=agreement,
        values={
            "legs": int((sketch["kind"] == FOOT).sum()),
            "touchdown_n": at_touchdown_n,
            "stiffness_n_m": float(-line[0]),
            "bent_n": float(bent_n),
        },
        reason="drawing",
    )


def robot_row(robot: plant.SteeredHopper, tables: Mapping[str, pd.DataFrame]) -> Row:
    """Judge item 51: the boom's neutral place is at the robot's centre."""
    sketch = tables["steered_sketch"]
    weight = sketch.loc[sketch["kind"] == COUNTERWEIGHT, POINT].to_numpy()[0]
    hopper = robot.hopper
    share = hopper.counterweight_mass_kg / hopper.total_mass_kg
    farthest_m = hopper.boom_offset_m + hopper.boom_radius_m
    neutral_mm = 1e3 * share * float(np.hypot(*weight[:2]))
    agreement = Agreement.DIFFERS
    if neutral_mm < EXACT:
        agreement = Agreement.BUILT
    return Row(
        item=51,
        agreement=agreement,
        values={
            "neutral_mm": neutral_mm,
            "farthest_mm": 1e3 * share * farthest_m,
            "body_markers": int((sketch["kind"] == BODY_MARKER).sum()),
            "legs": int((sketch["kind"] == FOOT).sum()),
            "counterweight_kg": hopper.counterweight_mass_kg,
            "mass_kg": hopper.mass_kg,
        },
        reason="drawing",
    )


# Item 52: how a stance is noticed.


def _delays(
    robot: plant.SteeredHopper,
    geometry: HopperGeometry,
    seeds: Sequence[int],
    effort: Effort,
) -> pd.DataFrame:
    tables = []
    for seed in seeds:
        noticed = noticed_stances(
            robot, geometry, hops=effort.noticed_hops, seed=int(seed)
        )
        # The last stance may not be recognised before the frames end.
        whole = noticed.stances.iloc[:-1]
        tables.append(whole.assign(seed=seed, false=noticed.n_false))
    return pd.concat(tables, ignore_index=True)


def stance_row(delays: pd.DataFrame) -> Row:
    """Judge item 52: whether both ways notice the same stances."""
    by_seed = delays.groupby("seed")
    loaded = 100 * by_seed["loaded_s"].apply(lambda one: one.notna().mean())
    found = 100 * by_seed["found_s"].apply(lambda one: one.notna().mean())
    false = by_seed["false"].first()
    later = 1e3 * (delays["lowest_s"] - delays["loaded_s"])
    told = 1e3 * (delays["recognised_s"] - delays["loaded_s"])
    same = bool((loaded == 100).all() and (found == 100).all() and not false.any())
    agreement = Agreement.DIFFERS
    if same:
        agreement = Agreement.PARTLY
    return Row(
        item=52,
        agreement=agreement,
        values={
            "loaded": loaded.tolist(),
            "found": found.tolist(),
            "false": false.tolist(),
            "lowest_ms": later.groupby(delays["seed"]).median().tolist(),
            "told_ms": told.groupby(delays["seed"]).median().tolist(),
        },
        reason="later" if same else "missed",
    )


# Item 53: the largest swing.


def _falls(
    robot: plant.SteeredHopper, seeds: Sequence[int], effort: Effort
) -> pd.DataFrame:
    rows = []
    for seed in seeds:
        for weight_kg in (LIGHT_KG, HEAVY_KG):
            hopper = replace(robot.hopper, counterweight_mass_kg=weight_kg)
            free = replace(robot, hopper=hopper, swing_limit_rad=np.pi)
            for swing_deg in FALL_SWINGS_DEG:
                falls = turning.falls_by_swing(
                    free, np.radians(swing_deg), seed=int(seed), hops=effort.fall_hops
                )
                rows.append(
                    {
                        "seed": seed,
                        "weight_kg": weight_kg,
                        "swing_deg": swing_deg,
                        "fell": 100 * falls.share,
                    }
                )
    return pd.DataFrame(rows)


def limit_row(robot: plant.SteeredHopper, falls: pd.DataFrame) -> Row:
    """Judge item 53: whether swings beyond the printed limit tip the robot over."""

    def fell(weight_kg: float, swing_deg: float) -> list[float]:
        rows = falls[
            (falls["weight_kg"] == weight_kg) & (falls["swing_deg"] == swing_deg)
        ]
        return [float(one) for one in rows["fell"]]

    # A commanded swing beyond the limit is cut to it.
    limited = replace(robot, swing_limit_rad=np.radians(PRINTED_LIMIT_DEG))
    apex = plant.released(limited, np.zeros(3))
    cut = plant.steer_hop(limited, apex, np.pi, rng=np.random.default_rng(0))
    beyond = FALL_SWINGS_DEG[-1]
    heavy_beyond = float(np.median(fell(HEAVY_KG, beyond)))
    heavy_within = float(np.median(fell(HEAVY_KG, PRINTED_LIMIT_DEG)))
    tips_beyond = heavy_beyond > heavy_within
    light_tips = float(np.median(fell(LIGHT_KG, beyond))) > 0
    agreement = Agreement.DIFFERS
    if tips_beyond and light_tips:
        agreement = Agreement.AGREES
    elif tips_beyond:
        agreement = Agreement.PARTLY
    return Row(
        item=53,
        agreement=agreement,
        values={
            "cut_deg": float(np.degrees(cut.swing_rad)),
            "limit_deg": float(np.degrees(robot.swing_limit_rad)),
            "light_kg": LIGHT_KG,
            "heavy_kg": HEAVY_KG,
            "beyond_deg": beyond,
            "light_beyond": fell(LIGHT_KG, beyond),
            "heavy_45": fell(HEAVY_KG, FALL_SWINGS_DEG[0]),
            "heavy_90": fell(HEAVY_KG, PRINTED_LIMIT_DEG),
            "heavy_beyond": fell(HEAVY_KG, beyond),
        },
        reason="weight",
    )


# Item 71: the threads of the live loop.


def threads_of_a_drive(
    robot: plant.SteeredHopper, geometry: HopperGeometry, seconds: float
) -> tuple[set[str], Drive]:
    """Drive a simulated robot in real time; return hopdata's threads, and the drive."""
    boom = SimulatedBoom()
    stream = SimulatedStream(LiveHopper(robot, boom.newest))
    alive: set[str] = set()

    def look(_loop: ControlLoop, _stream: Stream) -> None:
        alive.update(one.name for one in threading.enumerate())

    driven = drive(
        geometry,
        Unheeding(robot.swing_limit_rad / 2, np.random.default_rng(0)),
        boom,
        stream=stream,
        stop=threading.Event(),
        seconds=seconds,
        on_look=look,
    )
    return {name for name in alive if name.startswith("hopdata-")}, driven


def loop_row(alive: set[str], driven: Drive) -> Row:
    """Judge item 71: whether the printed threads, and those declared, are alive."""
    declared = set(live_parts.threads(simulated=True, log=False))
    both = {live_parts.SIMULATED, live_parts.CONTROL}
    latencies = np.array([one.latency_s for one in driven.decisions])
    latency_ms = float(1e3 * np.nanmedian(latencies)) if len(latencies) else np.nan
    agreement = Agreement.DIFFERS
    if both <= alive and alive == declared:
        agreement = Agreement.BUILT
    return Row(
        item=71,
        agreement=agreement,
        values={
            "threads": len(alive),
            "declared": len(declared),
            "stances": len(driven.decisions),
            "frames": driven.loop.frames,
            "overrun": driven.loop.overrun,
            "latency_ms": latency_ms,
        },
        reason="more_threads",
    )


# Item 74: the board.


def pushed_board(robot: plant.SteeredHopper, seed: int) -> pd.DataFrame:
    """Let the robot hop ahead into a board; see `board_figure` for the columns."""
    board = plant.Board(direction=(1.0, 0.0), place_m=0.75)
    rng = np.random.default_rng(seed)
    # With the boom at the front, swings to and fro take the hopper ahead.
    apex = plant.released(robot, np.zeros(3), 0.0)
    rows = []
    for k in range(BOARD_HOPS):
        swing = BOARD_SWING_RAD * (-1) ** k
        hop = plant.steer_hop(robot, apex, swing, rng=rng, board=board)
        board = board.pushed(hop)
        apex = hop.end
        x, y, heading = hop.stance.pose
        rows.append(
            {
                "x_m": x,
                "y_m": y,
                "heading_rad": heading,
                "board_m": board.place_m,
                "touched": hop.stance.touched,
                "reach_m": board.reach_m,
                "drag_n": board.drag_n,
            }
        )
    return pd.DataFrame(rows)


def board_row(board: pd.DataFrame) -> Row:
    """Judge item 74: the robot pushes the board, which impedes it."""
    steps_mm = 1e3 * np.diff(board["x_m"].to_numpy())
    pushing = board["touched"].to_numpy(dtype=bool)[1:]
    moved_m = float(board["board_m"].iloc[-1] - board["board_m"].iloc[0])
    ahead_m = float(board["x_m"].iloc[-1] - board["x_m"].iloc[0])
    free = float(steps_mm[~pushing].mean()) if (~pushing).any() else np.nan
    impeded = float(steps_mm[pushing].mean()) if pushing.any() else np.nan
    agreement = Agreement.DIFFERS
    # It goes on through the board, which impedes it; but the printed board takes up
    # momentum, and this one has no mass.
    if moved_m > 0 and ahead_m > 0 and impeded < free:
        agreement = Agreement.PARTLY
    return Row(
        item=74,
        agreement=agreement,
        values={
            "moved_m": moved_m,
            "stances": len(board),
            "pushing": int(board["touched"].sum()),
            "free_mm": free,
            "impeded_mm": impeded,
            "drag_n": float(board["drag_n"].iloc[0]),
        },
        reason="drawing",
    )
