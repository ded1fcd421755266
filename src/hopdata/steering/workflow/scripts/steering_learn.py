"""Observe an excitation, simulated if none was recorded, and learn from it."""

import numpy as np

from hopdata.jobs import reported, write_json, write_table
from hopdata.recordings.readers.hdf5 import read_recording, write_recording
from hopdata.steering.control.forecast import forecast
from hopdata.steering.models.learning import learn, learned_and_rest
from hopdata.steering.models.process_file import save_process
from hopdata.steering.observation.observe import observe_recordings
from hopdata.steering.strides import to_table
from hopdata.steering.trial import simulate_excitation

with reported(snakemake.log[0], snakemake.input, snakemake.output):
    steering = snakemake.params.steering
    output = snakemake.output
    observation = snakemake.params.observation
    number = int(snakemake.wildcards.seed.partition("_")[0])
    seed = np.random.SeedSequence(snakemake.params.seed, spawn_key=(number,))
    recordings = [read_recording(path) for path in snakemake.input]
    if not recordings:
        trial = simulate_excitation(
            steering,
            snakemake.params.motion_capture,
            seed=seed,
            observation=observation,
        )
        recordings = [trial.recording]
        write_recording(output.recording, trial.recording)
        write_table(output.true_stances, trial.stances)
        write_table(output.true_motion, trial.motion)
    limit = steering["robot"]["swing_limit_rad"]
    observed = observe_recordings(
        recordings, swing_limit_rad=limit, observation=observation
    )
    process, scores = learn(observed.changes, steering["model"], seed=seed)
    _, rest = learned_and_rest(observed.changes, steering["model"], seed=seed)
    expected = forecast(process, rest, state=[np.pi])
    scores = scores.assign(**expected.columns())
    save_process(output.model, process)
    observed.geometry.save(output.geometry)
    write_table(output.changes, to_table(observed.changes))
    write_table(output.stances, observed.stances)
    write_table(output.motion, observed.motion)
    write_json(output.counts, observed.counts)
    write_table(output.scores, scores.assign(seed=number, observation=observation))
