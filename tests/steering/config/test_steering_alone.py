"""A study of the simulated robot needs no recordings and markers of its own."""

import pytest

from hopdata.config.loading import SIMULATED, load_config
from hopdata.errors import ConfigError
from hopdata.synthesis.camera import MotionCapture


def test_a_steering_study_is_its_block_alone():
    config = load_config({"study": "alone", "steering": {"experiments": {"seeds": 2}}})
    assert [entry["name"] for entry in config["recordings"]] == ["hopper"]
    assert config["markers"] == SIMULATED["markers"]
    assert len(config["markers"]["body"]) == len(MotionCapture().markers.body_m)


@pytest.mark.parametrize(
    "config",
    [
        {"study": "alone"},
        {"study": "alone", "steering": {}, "recordings": [{"name": "hopper"}]},
        {"study": "alone", "steering": {}, "markers": SIMULATED["markers"]},
    ],
)
def test_a_study_of_recordings_names_them_and_their_markers(config):
    with pytest.raises(ConfigError, match=r"(recordings|markers): expected this key"):
        load_config(config)


def test_recordings_that_steering_names_must_be_there():
    config = {"study": "alone", "steering": {"recordings": ["walk"]}}
    with pytest.raises(ConfigError, match=r"steering.recordings\[0\]: expected one of"):
        load_config(config)
