"""Configuration: one schema, loaded, checked and documented."""

from hopdata.config.loading import load_config
from hopdata.config.recordings import simulation_of

__all__ = ["load_config", "simulation_of"]
