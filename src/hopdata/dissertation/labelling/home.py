"""Home frame and units (items 30 and 31)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.dissertation.labelling.agreement import agrees, built, close
from hopdata.dissertation.labelling.sample_by_both import used_of
from hopdata.dissertation.rows import Agreement, Row

if TYPE_CHECKING:
    from hopdata.dissertation.labelling.sample_by_both import Both

# What the dissertation prints, with its section.
LENGTH_M = 29.13e-3  # Fig. 2.4
TIME_S = 27e-3  # Fig. 2.4
WORST_POSITION_M = 4e-3  # 2.3
WORST_VELOCITY_M_S = 0.14  # 2.3


def home_frame(both: Both, seeds: Sequence[int]) -> Row:
    """Item 30: states do not change if the plane is shifted and turned."""
    from hopdata.landings.states.home_frames import home_frames

    recording = both.recording
    table = used_of(both.ours.touchdowns)
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
    return Row(30, built(max(changes) < 1e-9), values)


def units(both: Both) -> Row:
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
    consistent = close(values["text_velocity"], values["text_position"])
    same = close(printed["length_unit_m"], LENGTH_M) and close(
        printed["time_unit_s"], TIME_S
    )
    agreement = Agreement.DIFFERS
    if consistent:
        agreement = agrees(same, Agreement.PARTLY)
    return Row(31, agreement, values, "another_body")
