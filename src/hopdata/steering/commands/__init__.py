"""The commands ``hopdata drive``, ``hopdata learn`` and ``hopdata replay``."""
