import numpy as np
import pytest

from hopdata.recordings.recording import Recording
from hopdata.report.inputs import ReportInputs, describe_recording
from hopdata.report.page import build_report


def recording(n=5):
    positions = np.zeros((n, 6, 3))
    positions[:1, 0, 2] = np.nan
    names = ("b1", "b2", "b3", "f1", "f2", "boom")
    roles = ("body",) * 3 + ("foot",) * 2 + ("boom",)
    time = np.arange(n) / 100
    return Recording("run", time, positions, names, roles, 100.0, source="some/where/run.tsv")


def test_a_recording_is_described():
    entry = describe_recording(recording())
    assert entry.pop("duration_s") == pytest.approx(0.04)
    assert entry.pop("seen") == pytest.approx(29 / 30)
    assert entry == {
        "name": "run",
        "source": "run.tsv",
        "n_frames": 5,
        "rate_hz": 100.0,
        "n_feet": 2,
        "n_body": 3,
    }


def test_a_recording_without_frames_is_described_too():
    entry = describe_recording(recording(0))
    assert (entry["n_frames"], entry["duration_s"], entry["seen"]) == (0, 0.0, None)


def test_the_description_reaches_the_page():
    page = build_report(ReportInputs("s", recordings=[describe_recording(recording())]))
    for cell in ("run.tsv", "96.67", "0.0"):
        assert f">{cell}<" in page
