"""The commands ``hopdata drive`` and ``hopdata replay``."""
