"""Numbers and the words behind them."""

from __future__ import annotations


def counted(number: int, word: str) -> str:
    """Write ``1 frame``, ``2 frames``."""
    return f"{number} {word}" + ("" if number == 1 else "s")
