"""What `hopdata inspect` prints, as an object."""

import numpy as np
import pytest
from made_up_hopper import MARKERS, hopping
from written_files import write_c3d

import hopdata as hd
from hopdata.__main__ import main
from hopdata.recordings.raw import RawRecording


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """Return a file in mm, in which a marker is unseen and one spikes."""
    path = tmp_path_factory.mktemp("inspected") / "hops.c3d"
    time, positions = hopping(5, n_frames=400)
    positions[100:110, 2] = np.nan
    positions[200, 0] += 0.3
    write_c3d(path, RawRecording(MARKERS, time, 1e3 * positions, 100.0, "mm"))
    return path


def test_an_inspection_prints_what_the_command_prints(file, capsys):
    found = hd.inspect(file)
    main(["inspect", str(file)])
    assert capsys.readouterr().out.rstrip("\n") == str(found)
    assert len(repr(found)) < 400
    assert "<pre>" in found._repr_html_()


def test_an_inspection_has_tables(file):
    found = hd.inspect(file)
    table = found.table.set_index("marker")
    assert table.loc[MARKERS[2], "gaps"] == 1
    assert table.loc[MARKERS[2], "unseen"] == pytest.approx(10 / 400)
    assert table.loc[MARKERS[2], "longest_s"] == pytest.approx(0.1)
    assert found.suspects["kind"].tolist() == ["spike"]
    assert found.suspects["frame"].tolist() == [201]
    assert found.plot().axes
    # A recording is inspected as its file is.
    again = hd.inspect(hd.read(file))
    assert again.suspects["frame"].tolist() == [201]
    assert again.table["gaps"].tolist() == found.table["gaps"].tolist()
    for wrong, told in (
        (lambda: hd.inspect(3), "source: expected the path of a file, or a recording"),
        (lambda: hd.inspect("no.c3d"), "no.c3d: expected a file, found none"),
        (lambda: hd.inspect(file, rate=100), "did you mean 'rate_hz'"),
        (
            lambda: hd.inspect(hd.read(file), unit="mm", rate_hz=50),
            "unit, rate_hz: expected none for a recording, .* found mm",
        ),
        (
            lambda: hd.inspect(hd.read(file), vertical_axis="y"),
            "vertical_axis: expected none for a recording",
        ),
    ):
        with pytest.raises(hd.HopdataError, match=told):
            wrong()
