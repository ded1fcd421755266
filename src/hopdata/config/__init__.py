"""Configuration: one schema, loaded, checked and documented."""

from hopdata.config.consistency import files_of, simulation_of
from hopdata.config.loading import load_config

__all__ = ["files_of", "load_config", "simulation_of"]
