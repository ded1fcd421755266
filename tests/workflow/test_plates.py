"""Force plates in a recording's own file are compared in a study, without a key."""

import numpy as np
import pandas as pd
import pytest
from checkouts import completed, copy_checkout, edit_config
from plate_files import CORNERS, PlateFile, Stance, write_plates
from scipy.ndimage import uniform_filter1d

import hopdata as hd
from hopdata.recordings.raw import RawRecording

pytestmark = pytest.mark.workflow

HOPS = 60
PER_FRAME = 10
STANDS_S = 0.15


def hopping_on_a_plate(path):
    """Write a hopper whose first foot lands on a plate; return these contacts, s."""
    recording, truth = hd.synthesize("hopper", simulation={"hops": HOPS}, seed=3)
    middle_mm = CORNERS[0].mean(axis=0)
    # The plate travels with the foot, as one of a large floor.
    way_m = uniform_filter1d(recording.feet[:, 0, :2], 41, axis=0)
    positions_mm = 1000 * recording.positions
    positions_mm[:, :, :2] += middle_mm[:2] - 1000 * way_m[:, None]
    raw = RawRecording(
        recording.markers, recording.time, positions_mm, recording.rate_hz, "mm"
    )
    contacts_s = truth.contact_times[:, 0]
    n_samples = PER_FRAME * len(recording.time)
    at_s = recording.time[0] + np.arange(n_samples) / (PER_FRAME * recording.rate_hz)
    since_s = at_s[:, None] - contacts_s
    since_s = np.where(since_s >= 0, since_s, np.inf).min(axis=1)
    bears_n = np.where(since_s < STANDS_S, 600.0 * np.minimum(since_s / 0.03, 1.0), 0.0)
    noise_n = np.random.default_rng(4).normal(0, 0.5, n_samples)
    force = np.stack([0 * at_s, 0 * at_s, bears_n + noise_n], axis=1)
    where = np.tile(middle_mm, (n_samples, 1))
    write_plates(path, raw, [Stance(force, where, 0 * at_s)], PlateFile(2))
    return contacts_s


def test_a_study_compares_with_the_plates_of_its_file(tmp_path):
    checkout = copy_checkout(tmp_path)
    file = checkout / "data" / "external" / "plate.c3d"
    file.parent.mkdir(parents=True)
    contacts_s = hopping_on_a_plate(file)

    def from_file(config):
        config["study"] = "plates"
        config["recordings"] = [{"name": "day", "file": "data/external/plate.c3d"}]
        del config["simulation"]

    edited = edit_config(checkout, from_file)
    tables = checkout / "results" / "plates" / "tables"
    target = tables.relative_to(checkout) / "contact_overlay.csv"
    completed(checkout, "--configfile", edited, "--", target)
    overlay = pd.read_csv(tables / "contact_overlay.csv")
    assert set(overlay["column"]) == {"plate 1"}
    matched = overlay.dropna(subset=["difference_s"])
    assert len(matched) > 0.9 * len(contacts_s)
    assert matched["difference_s"].abs().max() < 0.005
    summary = pd.read_csv(tables / "contact_overlay_summary.csv")
    assert summary["recording"].tolist() == ["day"]
