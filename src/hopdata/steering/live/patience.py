"""How long a stream waits for what."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Patience:
    """How long the stream waits, s.

    `answer_s`: for an answer or the first frame. `late_s`: a frame delayed by more than this,
    beyond the shortest delay, counts as late. `stale_s`: with no frame for so long the stream is
    stale, and after `reconnect_s` it is given up. A connection that is lost is tried again after
    `retry_s`, then after twice that, and so on up to `longest_retry_s`.
    """

    answer_s: float = 5.0
    late_s: float = 0.02
    stale_s: float = 0.1
    reconnect_s: float = 2.0
    retry_s: float = 0.1
    longest_retry_s: float = 5.0
