import pytest

from hopdata.errors import ConfigError
from hopdata.synthesis.options import Kicks, MarkerOptions, from_mapping


def test_given_keys_replace_defaults_and_lists_become_tuples():
    markers = from_mapping(MarkerOptions, {"boom_m": [0.0, 0.0, 0.1]}, "markers")
    assert markers.boom_m == (0.0, 0.0, 0.1)
    assert markers.retraction_s == MarkerOptions().retraction_s
    assert from_mapping(Kicks, None, "kicks") == Kicks()


def test_a_misspelt_key_is_answered_with_the_nearest():
    with pytest.raises(ConfigError, match=r"kicks\.velocity_ms: .*did you mean 'velocity_m_s'"):
        from_mapping(Kicks, {"velocity_ms": 0.1}, "kicks")
