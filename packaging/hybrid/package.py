"""The integrator of hopdata on its own: `hopdata.hybrid`, and nothing else.

    from hopdata.hybrid import System, solve

This is ``hopdata/__init__.py`` of the wheel that holds the integrator alone.
"""

from importlib import import_module
from importlib.metadata import version

_FROM_HYBRID = ("System", "solve")
__version__ = version("hopdata-hybrid")
__all__ = sorted(_FROM_HYBRID)  # noqa: PLE0605


def __getattr__(name: str) -> object:
    """Import a public name when it is first used."""
    if name in _FROM_HYBRID:
        return getattr(import_module("hopdata.hybrid"), name)
    raise AttributeError(
        f"hopdata has no attribute {name!r} here: only the integrator, hopdata.hybrid, "
        "is installed; `pip install hopdata` brings the rest"
    )


def __dir__() -> list[str]:
    return sorted({*globals(), *_FROM_HYBRID})
