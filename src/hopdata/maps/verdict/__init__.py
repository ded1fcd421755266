"""The verdict on a study: whether the map through the landing is C1."""

from hopdata.maps.verdict.answer import Verdict
from hopdata.maps.verdict.judge import judge

__all__ = ["Verdict", "judge"]
