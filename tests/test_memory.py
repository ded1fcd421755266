"""Long recordings: memory holds them once, and blocks of any size give the same bytes."""

import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hopdata.landings import schedules
from hopdata.landings.contacts import approach, descents, doubted, kink, noise
from hopdata.landings.contacts.find import find_landings
from hopdata.landings.filling import fill_gaps
from hopdata.landings.floor import fit_floor, level
from hopdata.landings.sections import densities
from hopdata.landings.sections.select import select_sections
from hopdata.landings.sections.tables import section_densities
from hopdata.landings.stability import section_stability
from hopdata.landings.states import coefficients, fits, tracks
from hopdata.landings.states.assemble import assemble_pairs
from hopdata.landings.states.pairs import DESCRIPTIONS
from hopdata.landings.touchdowns import touchdown_table
from hopdata.recordings.plausibility import check_plausible, notes
from hopdata.recordings.quality import free_fall, rigid, surprises, timing
from hopdata.recordings.quality.inspection import recording_tables
from hopdata.recordings.readers.hdf5 import read_recording, write_recording

SAMPLE = Path(__file__).parents[1] / "data/sample/hopper.h5"
#: Bytes per frame in addition to the 176 of seven markers: 10 million frames take 3.0
#: GB. The search for landings takes the most, 120: it holds times and heights in the
#: animal's own scale.
BESIDE = 125
LENGTHS = (6_000, 15_000, 30_000)  # in frames


@pytest.fixture(scope="module")
def sample():
    return read_recording(SAMPLE)


@pytest.fixture
def small_blocks(monkeypatch):
    for module, name, size in (
        (densities, "BLOCK", 997),
        (descents, "BLOCK", 101),
        (approach, "LANDINGS", 7),
        (kink, "BLOCK", 11),
        (timing, "BLOCK", 1_000),
        (doubted, "BLOCK", 997),
        (tracks, "LARGEST", 30_000),
    ):
        monkeypatch.setattr(module, name, size)


@pytest.fixture
def small_samples(monkeypatch):
    for module in (noise, free_fall, rigid, surprises):
        monkeypatch.setattr(module, "MOST_FRAMES", 5_000)
    monkeypatch.setattr(schedules, "CHUNK", 20)
    for module in (tracks, fits, coefficients):
        monkeypatch.setattr(module, "LOOK_AT", 40)


def studied(recording):
    """Return everything made from a recording, from its floor to its touchdowns."""
    ready = fill_gaps(level(recording, fit_floor(recording)))
    landings = find_landings(ready)
    known = {ready.name: landings}
    sections = select_sections([ready], landings=known)
    heights = {
        "pre_height_m": sections.pre_height_m,
        "post_height_m": sections.post_height_m,
    }
    densities = section_densities([ready], sections, known)
    return (
        ready,
        landings,
        sections,
        densities,
        touchdown_table(ready, landings=landings, **heights),
    )


@pytest.fixture(scope="module")
def whole(sample):
    return studied(sample.part(slice(20_000)))


def test_blocks_of_any_size_give_the_same_bytes(sample, whole, request):
    part = sample.part(slice(20_000))
    request.getfixturevalue("small_blocks")
    pieces = studied(part)
    np.testing.assert_array_equal(whole[0].positions, pieces[0].positions)
    assert whole[2] == pieces[2]
    for one, other in zip(whole[1::2], pieces[1::2], strict=True):
        assert one.equals(other)
    assert whole[4].equals(pieces[4])


@pytest.mark.parametrize(
    "options",
    [{}, {"gravity": "known"}, {"gravity": "free"}, {"method": "savitzky_golay"}],
    ids=str,
)
def test_states_fitted_in_blocks_of_any_size_are_the_same_bytes(
    whole, options, monkeypatch, request
):
    ready, _, sections, _, table = whole
    heights = {
        "pre_height_m": sections.pre_height_m,
        "post_height_m": sections.post_height_m,
    }
    monkeypatch.setattr(tracks, "LARGEST", 10**9)
    whole = assemble_pairs([ready], table, **heights, **options)
    request.getfixturevalue("small_blocks")
    pieces = assemble_pairs([ready], table, **heights, **options)
    for name in DESCRIPTIONS:
        np.testing.assert_array_equal(getattr(whole, name), getattr(pieces, name))


def test_what_is_overwritten_is_what_is_returned(sample):
    part = sample.part(slice(5_000))
    part = replace(part, positions=part.positions.copy())
    part.positions[100:103, 0] = np.nan
    floor, positions = fit_floor(part), part.positions.copy()
    apart = fill_gaps(level(part, floor))
    np.testing.assert_array_equal(part.positions, positions)
    there = fill_gaps(level(part, floor, overwrite=True), overwrite=True)
    assert there.positions is part.positions
    np.testing.assert_array_equal(there.positions, apart.positions)


@pytest.fixture(scope="module")
def levelled(sample):
    """Return as much of the sample as is needed, above its floor, and its landings."""
    part = sample.part(slice(LENGTHS[-1]))
    ready = level(part, fit_floor(part))
    return ready, find_landings(ready)


def pair(recording, landings):
    sections = select_sections([recording], landings={recording.name: landings})
    heights = {
        "pre_height_m": sections.pre_height_m,
        "post_height_m": sections.post_height_m,
    }
    assemble_pairs(
        [recording], touchdown_table(recording, landings=landings, **heights), **heights
    )


def choose(recording, landings):
    known = {recording.name: landings}
    sections = select_sections([recording], landings=known)
    section_densities([recording], sections, known)
    section_stability([recording], sections, {}, known)


STAGES = {
    "read": lambda one, _, path: (
        write_recording(path, one),
        recording_tables([read_recording(path)]),
    ),
    "check": lambda one, *_: (check_plausible(one), notes(one)),
    "level": lambda one, *_: fill_gaps(
        level(one, fit_floor(one), overwrite=True), overwrite=True
    ),
    "find": lambda one, *_: find_landings(one),
    "pair": lambda one, landings, _: pair(one, landings),
    "choose": lambda one, landings, _: choose(one, landings),
}


@pytest.mark.parametrize("stage", STAGES)
def test_memory_holds_a_recording_once(
    levelled, stage, small_blocks, small_samples, tmp_path
):
    """Memory is measured by its growth with the frames; all else is the same for any length."""
    ready, landings = levelled
    taken = []
    for run, frames in enumerate(LENGTHS):
        part = ready.part(slice(frames))
        part = replace(part, positions=part.positions.copy())
        own = landings[landings["end_s"] < part.time[-1]]
        if run > 0:  # the first run does the imports, which need not be traced
            tracemalloc.start()
        STAGES[stage](part, own, tmp_path / "x.h5")
        taken.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    held = 176 if stage == "read" else 0  # the other stages receive the recording
    assert (taken[2] - taken[1]) / (LENGTHS[2] - LENGTHS[1]) < held + BESIDE
