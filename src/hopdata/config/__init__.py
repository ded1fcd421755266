"""Configuration: one schema, loaded, checked and documented."""

from hopdata.config.loading import load_config

__all__ = ["load_config"]
