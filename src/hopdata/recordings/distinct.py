"""No landing may count twice: the same content under two names is refused."""

from __future__ import annotations

from collections.abc import Iterable

from hopdata.errors import RecordingError
from hopdata.recordings.recording import Recording

SEPARATOR = ", "  # between the files of one recording, and between their digests


def require_distinct(recordings: Iterable[Recording]) -> None:
    """Refuse files that are byte for byte the same, in one recording or in two.

    Raises
    ------
    RecordingError
        Naming both files.
    """
    known: dict[str, str] = {}
    for recording in recordings:
        for number, digest in enumerate(filter(None, recording.source_sha256.split(SEPARATOR))):
            here = f"file {number + 1} of recording '{recording.name}'"
            if digest in known:
                raise RecordingError(
                    f"{recording.place}: expected each file once, found the bytes of {here} in "
                    f"{known[digest]} as well: their landings would count twice"
                )
            known[digest] = here
