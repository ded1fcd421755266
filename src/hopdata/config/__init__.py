"""Configuration: one schema, loaded, checked and documented."""

from hopdata.config.consistency import (
    contact_options,
    expected_noise_m,
    files_of,
    fills,
    is_simulated,
    simulation_of,
)
from hopdata.config.loading import load_config

__all__ = [
    "contact_options",
    "expected_noise_m",
    "files_of",
    "fills",
    "is_simulated",
    "load_config",
    "simulation_of",
]
