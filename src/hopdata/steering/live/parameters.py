"""What we serve and read of a Qualisys system's settings: labels and frame rate, in XML."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass

from hopdata.errors import did_you_mean
from hopdata.steering.live.errors import GarbageError, LabelError, SettingsError
from hopdata.steering.live.packets import VERSION

RATE_SLACK = 0.05


@dataclass(frozen=True)
class StreamParameters:
    """Labels of the markers in the order of the stream; what is not told is None or empty.

    `rate_hz` is the frame rate, Hz; `upwards` the axis that points up, as "+Z".
    """

    labels: tuple[str, ...]
    rate_hz: float | None
    upwards: str = ""


def parameters_xml(labels: Sequence[str], rate_hz: float, *, parts: Sequence[str]) -> str:
    """Return the answer to `getparameters` for the parts "general", "3d" or "all"."""
    root = ET.Element(f"QTM_Parameters_Ver_{VERSION}")
    if {"general", "all"} & set(parts):
        general = ET.SubElement(root, "General")
        ET.SubElement(general, "Frequency").text = f"{rate_hz:g}"
    if {"3d", "all"} & set(parts):
        settings = ET.SubElement(root, "The_3D")
        ET.SubElement(settings, "AxisUpwards").text = "+Z"
        ET.SubElement(settings, "Labels").text = str(len(labels))
        for name in labels:
            label = ET.SubElement(settings, "Label")
            ET.SubElement(label, "Name").text = name
    return ET.tostring(root, encoding="unicode")


def read_parameters(document: str | bytes) -> StreamParameters:
    """Read labels and frame rate.

    Raises
    ------
    GarbageError
        If the document is not XML.
    """
    try:
        root = ET.fromstring(document)
    except ET.ParseError as error:
        raise GarbageError(f"settings of the stream: expected XML ({error})") from error
    names = [label.findtext("Name", "") for label in root.findall("./The_3D/Label")]
    frequency = root.findtext("./General/Frequency")
    try:
        rate = float(frequency) if frequency else None
    except ValueError:
        rate = None
    upwards = root.findtext("./The_3D/AxisUpwards", "").strip().upper()
    return StreamParameters(tuple(names), rate if rate and rate > 0 else None, upwards)


def check_settings(parameters: StreamParameters, rate_hz: float | None) -> None:
    """Check what a stream says of itself, as far as it does.

    Parameters
    ----------
    parameters : StreamParameters
    rate_hz : float or None
        The frame rate that is expected, Hz; None for any.

    Raises
    ------
    SettingsError
        If z does not point up, or the frame rate is another one.
    """
    if parameters.upwards not in ("", "+Z", "Z"):
        raise SettingsError(
            f"axis that points up in the stream: expected +Z, found {parameters.upwards}"
        )
    told = parameters.rate_hz
    if rate_hz is not None and told is not None and abs(told - rate_hz) > RATE_SLACK * rate_hz:
        raise SettingsError(f"frame rate of the stream: expected {rate_hz:g} Hz, found {told:g} Hz")


def find_labels(wanted: Sequence[str], labels: Sequence[str]) -> list[int]:
    """Return the place in the stream of each marker that is wanted.

    Raises
    ------
    LabelError
        If a label is missing, or stands there twice.
    """
    for name in wanted:
        if labels.count(name) != 1:
            found = ", ".join(labels) or "none"
            often = "not one of" if name not in labels else "more than once among"
            raise LabelError(
                f"marker {name!r} is {often} the labelled markers of the stream ({found})"
                f"{did_you_mean(name, labels) if name not in labels else ''}"
            )
    return [list(labels).index(name) for name in wanted]
