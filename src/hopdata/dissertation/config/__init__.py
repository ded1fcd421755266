"""The dissertation's block of the configuration."""
