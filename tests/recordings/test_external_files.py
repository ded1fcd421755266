"""What `hopdata check` says of forces: where they lie beside the recording."""

import pytest
from external_blocks import block, columns

from hopdata.recordings.external_files import describe_external


@pytest.fixture
def plate(tmp_path):
    path = tmp_path / "plate.csv"
    path.write_text("Fz\n" + "0\n30\n" * 50)
    return path


@pytest.mark.parametrize(
    ("rate_hz", "offset_s", "said"),
    [
        (100.0, 0.0, ""),
        (100.0, 0.2, ""),
        (50.0, 0.0, "covers 100 % of the recording, 49 % of it lies outside"),
        (1000.0, 0.0, "covers 10 % of the recording, 0 % of it lies outside"),
        (100.0, 5.0, "covers 0 % of the recording, 100 % of it lies outside"),
    ],
)
def test_forces_of_a_wrong_clock_are_pointed_out(plate, rate_hz, offset_s, said):
    forces = block(
        "forces", file=str(plate), rate_hz=rate_hz, offset_s=offset_s, columns=columns(Fz=["foot1"])
    )
    entry = {"contacts": block("contacts"), "forces": forces}
    (line,) = describe_external(entry, feet=["foot1"], span_s=(0.0, 1.0))
    assert said in line
    assert ("outside" in line) == bool(said)
