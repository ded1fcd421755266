"""Numbers in a C3D file, in the three byte orders that the format knows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Processor:
    """The kind of computer whose numbers a C3D file holds.

    Parameters
    ----------
    name : str
        ``"Intel"``, ``"DEC"`` or ``"MIPS"``.
    order : {"<", ">"}
        Order of the bytes of a whole number, as numpy writes it.
    """

    name: str
    order: str

    def whole(self, data: bytes | NDArray[np.uint8]) -> NDArray[np.int16]:
        """Decode 16-bit whole numbers with a sign."""
        return np.frombuffer(data, dtype=f"{self.order}i2").astype(np.int16)

    def floats(self, data: bytes | NDArray[np.uint8]) -> NDArray[np.float32]:
        """Decode 32-bit floating-point numbers; a DEC number has its halves exchanged."""
        raw = np.frombuffer(data, dtype=np.uint8)
        if self.name != "DEC":
            return raw.view(f"{self.order}f4")
        swapped = raw.view("<u2").reshape(-1, 2)[:, ::-1].copy().view("<f4").reshape(-1)
        with np.errstate(invalid="ignore"):  # a signalling NaN is a NaN
            quarter: NDArray[np.float32] = (swapped / np.float32(4)).astype(np.float32)
        return quarter

    def from_whole(self, values: Any) -> bytes:
        """Encode 16-bit whole numbers; up to 65535 as the same bits without a sign."""
        return (
            (np.atleast_1d(np.asarray(values, dtype=np.int64)) & 0xFFFF)
            .astype(f"{self.order}u2")
            .tobytes()
        )

    def from_floats(self, values: Any) -> bytes:
        """Encode 32-bit floating-point numbers."""
        if self.name != "DEC":
            return np.atleast_1d(values).astype(f"{self.order}f4").tobytes()
        halves = np.ravel(np.asarray(values, dtype="<f4") * np.float32(4)).view("<u2")
        return halves.reshape(-1, 2)[:, ::-1].tobytes()


# By the number that the file's parameter section begins with.
PROCESSORS = {84: Processor("Intel", "<"), 85: Processor("DEC", "<"), 86: Processor("MIPS", ">")}


def unsigned(value: float) -> int:
    """Whole number whose 16 bits may have been read with a sign: counts have none."""
    return int(value) + (65536 if value < 0 else 0)
