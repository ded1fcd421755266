"""A laboratory's folder: subjects, trials, statics, other markers, copies, a broken file."""

from dataclasses import replace

import numpy as np
from made_up_hopper import MARKERS, hopping
from trc_files import trc_text
from written_files import write_c3d

from hopdata.recordings.raw import RawRecording

SUBJECTS = ("S01", "S02", "S03")
OTHER_MARKERS = ("PELA", "PELB", "PELC", "HEEL", "TOE", "BALL", "REF")
RATE_HZ = 100.0


def trial(seed, *, n_frames=600, names=MARKERS):
    """Return a recording of hops in mm, z up."""
    time, positions = hopping(seed, n_frames=n_frames)
    # No marker of a real file is at the origin to the last bit.
    return RawRecording(names, time, 1000 * positions, RATE_HZ, "mm")


def static(seed, *, n_frames=300):
    """Return a recording of a subject that stands, in mm."""
    positions = 1000 * np.repeat(hopping(seed, n_frames=2)[1][:1], n_frames, axis=0)
    noise = np.random.default_rng(seed).normal(0, 0.6, positions.shape)
    time = np.arange(n_frames) / RATE_HZ
    return RawRecording(MARKERS, time, positions + noise, RATE_HZ, "mm")


def write_trc(path, raw):
    """Write a recording as TRC, y up, with four digits."""
    turned = np.round(raw.positions[..., [1, 2, 0]], 4)
    path.write_text(trc_text(turned, raw.markers, rate_hz=raw.rate_hz))


def write_lab(folder, *, n_trials=8, n_frames=600):
    """Write 3 subjects' folders; return the names of the files that are trials."""
    trials = []
    for number, subject in enumerate(SUBJECTS):
        own = folder / subject
        own.mkdir(parents=True)
        for k in range(n_trials):
            raw = trial(100 * number + k, n_frames=n_frames)
            write_c3d(own / f"hop{k + 1}.c3d", raw)
            trials.append(f"{subject}/hop{k + 1}.c3d")
        write_c3d(own / "static.c3d", static(number))
    first = trial(0, n_frames=n_frames)
    write_trc(folder / "S01" / "other name.trc", first)
    second = trial(100, n_frames=n_frames)
    cut = slice(20, n_frames - 60)
    part = replace(second, time=second.time[cut], positions=second.positions[cut])
    write_trc(folder / "S02" / "cut.trc", part)
    write_c3d(folder / "S02" / "old set.c3d", trial(7, names=OTHER_MARKERS))
    write_c3d(folder / "S03" / "stopped.c3d", trial(8, n_frames=20))
    (folder / "S03" / "broken.c3d").write_bytes(b"\x02P" + bytes(100))
    (folder / "S03" / "notes.docx").write_text("lunch at noon")
    return sorted(trials)
