"""Answer from motion capture whether landing on several feet is one smooth map.

    import hopdata as hd

    study = hd.analyse("config/config.yaml", progress=print)
    study.verdict.sentence
    study.touchdowns
    study.figures.verdict()

The package follows the data's way, one sub-package a stage: ``hybrid`` and ``scenes`` simulate,
``synthesis`` observes, ``recordings`` reads, ``landings`` finds touchdowns, ``maps`` compares
linear models, ``figures`` draws and ``report`` gathers.
"""

from importlib import import_module

__version__ = "0.1.0"
_PLACES = {
    "HopdataError": "errors",
    "Recording": "recording",
    "Study": "analysis",
    "System": "hybrid",
    "analyse": "analysis",
    "judge": "maps.verdict",
    "plan": "analysis",
    "read": "analysis",
    "solve": "hybrid",
    "study": "analysis",
    "synthesize": "analysis",
}
__all__ = sorted(_PLACES)  # noqa: PLE0605


def __getattr__(name: str) -> object:
    """Import what a notebook needs when it is first used: `import hopdata` takes no time."""
    if name not in _PLACES:
        from hopdata.errors import absent

        raise absent("hopdata", name, _PLACES)
    value = getattr(import_module(f"hopdata.{_PLACES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_PLACES})
