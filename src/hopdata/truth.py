"""The `Truth` of a simulated recording, which only scoring reads."""

from dataclasses import dataclass

from hopdata.arrays import BoolArray, FloatArray, Shown
from hopdata.errors import mismatch


@dataclass(frozen=True, repr=False)
class Truth(Shown):
    """Truth of a synthetic recording of N frames, L landings and n feet.

    A landing runs from the apex of one hop to the apex of the next.

    Parameters
    ----------
    contact_times : (L, n) array
        Instant at which each foot first touched in each landing, s; NaN if it did not
        touch.
    apex_times : (L,) array
        Time of the apex before each landing, s.
    complete : (L,) bool array
        Whether all feet were on the floor at once.
    foot_down : (N, n) bool array
        Whether each foot was in contact in each frame.
    body_height : (N,) array
        Mean height of the body markers above the flat simulated floor, without noise,
        m.
    contact_points : (L, n, 2) array
        Point at which each foot first touched, in the world frame, m.
    floor_at_contacts : (L, n) array
        Height of the measured (curved) floor at these points, m.
    apex_states : (L, 12) array
        State of the body at the apex, after the kick (see `hopdata.scenes.body`).
    preloads_n : (L, n) array
        Preload of each leg in each landing, N.
    longer_m : (L, n) array, optional
        How much longer than usual each leg is in each landing, m; None if legs do not
        scatter.
    noise_m : float
        Standard deviation of the noise per marker coordinate, m.
    parameters_json : str
        All parameters of the simulation, as JSON.
    true_effect : float
        Relative difference between the exact maps of the contact orders, as the verdict
        measures it, between the sections of a study; NaN if it was not computed.
    """

    contact_times: FloatArray
    apex_times: FloatArray
    complete: BoolArray
    foot_down: BoolArray
    body_height: FloatArray
    contact_points: FloatArray
    floor_at_contacts: FloatArray
    apex_states: FloatArray
    preloads_n: FloatArray
    noise_m: float
    parameters_json: str
    true_effect: float = float("nan")
    longer_m: FloatArray | None = None

    def _told(self) -> str:
        """Return the numbers of landings and feet."""
        n_landings, n_feet = self.contact_times.shape
        return f"of {n_landings} landings on {n_feet} feet"


# Sizes of each array: letters are N frames, L landings and n feet; numbers are fixed.
_SIZES: dict[str, tuple[str | int, ...]] = {
    "contact_times": ("L", "n"),
    "apex_times": ("L",),
    "complete": ("L",),
    "foot_down": ("N", "n"),
    "body_height": ("N",),
    "contact_points": ("L", "n", 2),
    "floor_at_contacts": ("L", "n"),
    "apex_states": ("L", 12),
    "preloads_n": ("L", "n"),
    "longer_m": ("L", "n"),
}


def check_sizes(truth: Truth) -> None:
    """Check that the arrays of a truth agree in their frames, landings and feet.

    Raises
    ------
    ValueError
        If not; the message names the first array that does not match those before it.
    """
    known: dict[str, int] = {}
    for name, letters in _SIZES.items():
        values = getattr(truth, name)
        if values is None:
            continue
        shape = values.shape
        expected = []
        for letter, size in zip(letters, shape, strict=False):
            if isinstance(letter, int):
                expected.append(letter)
            else:
                expected.append(known.setdefault(letter, size))
        if len(shape) != len(letters) or list(shape) != expected:
            sizes = ", ".join(str(letter) for letter in letters)
            raise ValueError(mismatch(name, f"shape ({sizes}) of {known}", shape))
