"""The verdict on a study: whether the map through the landing is C1."""

from hopdata.maps.verdict.judge import Verdict, judge

__all__ = ["Verdict", "judge"]
