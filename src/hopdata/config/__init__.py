"""Configuration: one schema that is loaded, checked and documented."""
