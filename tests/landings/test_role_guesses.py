"""What is asked about guessed roles; `tests/commands/test_init.py` tests the guesses."""

from types import SimpleNamespace

import numpy as np

from hopdata.landings.role_guesses import open_questions, roles_in_file
from hopdata.messages import Message
from hopdata.recordings.quality.guess import Guess
from hopdata.recordings.quality.roles import Roles
from hopdata.recordings.raw import RawRecording

SURE = Guess("z", Message("recordings.given"))


def asked(up=SURE, **doubts):
    roles = Roles(("b1",), ("f1", "f2"), (), "", {}, (), (), unsure=doubts)
    return [str(one) for one in open_questions(SimpleNamespace(up=up), roles)]


def test_what_is_sure_is_not_asked():
    assert asked() == []


def test_what_is_unsure_is_asked_with_both_candidates():
    higher = Message("recordings.doubt_higher", {"marker": "m7", "above_mm": 30.0})
    (question,) = asked(feet=higher)
    assert question.startswith("feet: f1, f2, or m7")
    rather = Guess("z", Message("recordings.given"), is_sure=False, other="-y")
    (question,) = asked(rather)
    assert question.startswith("vertical_axis: z or -y?")


def test_a_file_states_roles_only_if_it_states_feet_and_body():
    def of(*roles):
        names = tuple("abc")
        return RawRecording(
            names, np.zeros(1), np.zeros((1, 3, 3)), 1.0, "m", roles=roles
        )

    assert roles_in_file(of("foot", "body", "boom")) == {"feet": ["a"], "body": ["b"]}
    assert roles_in_file(of("foot", "foot", "boom")) == {}
    assert roles_in_file(of()) == {}
