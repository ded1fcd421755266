"""Configuration: one schema, loaded, checked and documented."""

from hopdata.config.loading import load_config
from hopdata.config.recordings import files_of, simulation_of

__all__ = ["files_of", "load_config", "simulation_of"]
