"""Answer from motion capture whether landing on several feet is one smooth map.

The package follows the data's way, one sub-package a stage: ``hybrid`` and ``scenes`` simulate,
``synthesis`` observes, ``recordings`` reads, ``landings`` finds touchdowns, ``maps`` compares
linear models, ``figures`` draws and ``report`` gathers.
"""

__version__ = "0.1.0"
