"""Test with motion capture whether landing on several feet is one smooth map.

    import hopdata as hd

    study = hd.analyse("config/config.yaml", progress=print)
    study.verdict.sentence
    study.touchdowns
    study.figures.verdict()

The package follows the path of the data, with one sub-package per stage: ``hybrid`` and
``scenes`` simulate, ``synthesis`` simulates the cameras, ``recordings`` reads files,
``landings`` finds touchdowns, ``maps`` compares linear models, ``figures`` draws and
``report`` writes the page.
"""

import sys
from importlib import import_module

if sys.flags.safe_path:
    # As in the jobs of a study: what lies in the working folder is not to be trusted.
    from hopdata.foreign.settings import leave_unread

    leave_unread()

__version__ = "0.1.0"
_PLACES = {
    "HopdataError": "errors",
    "Recording": "recording",
    "Study": "analysis",
    "System": "hybrid",
    "analyse": "analysis",
    "contacts": "contact_times",
    "guess": "reading",
    "inspect": "inspecting.inspected",
    "judge": "maps.verdict",
    "load": "saved",
    "plan": "analysis",
    "read": "reading",
    "solve": "hybrid",
    "study": "analysis",
    "synthesize": "analysis",
}
__all__ = sorted(_PLACES)  # noqa: PLE0605


def __getattr__(name: str) -> object:
    """Import a public name when it is first used, so that `import hopdata` is fast."""
    if name not in _PLACES:
        from hopdata.errors import absent

        raise absent("hopdata", name, _PLACES)
    value = getattr(import_module(f"hopdata.{_PLACES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_PLACES})
