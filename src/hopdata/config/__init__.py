"""Configuration: one schema, loaded, checked and documented."""
