"""A note on a result: what it is about, and what is said of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from hopdata.messages import Message

# Ending of the template that says what a note is about.
_ABOUT = "_what"


@dataclass(frozen=True)
class Note:
    """A limit of a result, in words and for programs.

    Attributes
    ----------
    what, reason
        What it is about, and what is said of it, in English.
    code
        Code of the message that `reason` is, such as ``"maps.grazes"``; empty in files
        of versions without codes.
    values
        Values of this message: numbers, texts or other messages.
    """

    what: str
    reason: str
    code: str = ""
    values: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def of(cls, code: str, **values: Any) -> Note:
        """Return the note of this code with these values, in the words of its room."""
        about = Message(f"{code}{_ABOUT}")
        said = Message(code, values)
        return cls(str(about), str(said), code, values)

    @property
    def about(self) -> Message:
        """What it is about, to be said in any language that has words for it."""
        return Message(f"{self.code}{_ABOUT}")

    @property
    def said(self) -> Message:
        """What is said, to be said in any language."""
        return Message(self.code, self.values)

    def to_dict(self) -> dict[str, Any]:
        """Return plain data, for JSON."""
        return asdict(self)

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> Note:
        """Return the note of which `to_dict` made `content`.

        Files of earlier versions may lack any part of it.
        """
        code = str(content.get("code") or "")
        said = Message.from_dict({"code": code, "values": content.get("values") or {}})
        return cls(
            what=str(content.get("what") or ""),
            reason=str(content.get("reason") or ""),
            code=code,
            values=said.values,
        )
