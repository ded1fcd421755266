"""A guessed value with its reason."""

from dataclasses import dataclass

from hopdata.messages import Message


@dataclass(frozen=True)
class Guess:
    """A value and the reason for it.

    Parameters
    ----------
    value : str
        The value.
    why : Message
        The reason, a phrase shown to the user.
    is_sure : bool
        Whether the data support it; otherwise it is only the usual value.
    other : str
        The alternative value, if this one is not sure.
    evidence : tuple of Message
        All that was found for and against, one message each.
    overrules : str
        What the file states, where it cannot be and this value takes its place.
    """

    value: str
    why: Message
    is_sure: bool = True
    other: str = ""
    evidence: tuple[Message, ...] = ()
    overrules: str = ""

    @property
    def reason(self) -> str:
        """The reason in words."""
        return str(self.why)
