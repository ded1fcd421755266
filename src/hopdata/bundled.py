"""Where the workflow, the configurations and the sample are that come with hopdata."""

from pathlib import Path


def _snakefile() -> Path:
    """Return the workflow of a wheel, which is in the package, or that of a checkout.

    A link in the package would serve both, but a clone on Windows, or from an archive,
    has a text file in its place.
    """
    package = Path(__file__).resolve().parent
    of_wheel = package / "_workflow" / "Snakefile"
    of_checkout = package.parents[1] / "Snakefile"
    if of_checkout.is_file() and not of_wheel.is_file():
        return of_checkout
    return of_wheel


#: The workflow. Beside it are its rules, the configurations and the recordings of the
#: sample.
SNAKEFILE = _snakefile()
