"""Compute true states at the sections, and the exact maps between them."""

import numpy as np

from hopdata.jobs import read_json, reported, write_json
from hopdata.landings.states.pairs import Pairs, write_pairs
from hopdata.recordings.readers.hdf5 import read_truth
from hopdata.synthesis.landings import SectionHeights
from hopdata.synthesis.scaling import common_scene, exact_maps, true_states

COLUMNS = ("x", "y", "schedule", "spread_s", "touchdown")

with reported(snakemake.log[0], snakemake.input, snakemake.output):
    found = read_json(snakemake.input.sections)
    body = snakemake.params.markers["body"]
    truths = [read_truth(path) for path in snakemake.input.recordings]
    scene = common_scene(truths)
    sections = SectionHeights(
        found["pre_height_m"], found["post_height_m"], scene.points_of(body)
    )
    states = [true_states(truth, scene, sections) for truth in truths]
    lengths = [len(one.x) for one in states]
    columns = {
        name: np.concatenate([getattr(one, name) for one in states]) for name in COLUMNS
    }
    recording = np.repeat(np.array(snakemake.params.recordings), lengths)
    pairs = Pairs(**columns, recording=recording, body_markers=tuple(body))
    write_pairs(snakemake.output.pairs, pairs)
    write_json(snakemake.output.maps, exact_maps(truths, sections))
