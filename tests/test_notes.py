"""Notes on results: their words, and their form in files."""

import json

from hopdata.messages import Message
from hopdata.notes import Note

CODE = "maps.strongly_curved"


def test_a_note_has_the_words_of_its_code():
    note = Note.of(CODE, share="3 %", times="2.1")
    assert note.what == str(Message("maps.strongly_curved_what")) == str(note.about)
    assert note.reason == str(Message(CODE, {"share": "3 %", "times": "2.1"}))
    assert note.reason == str(note.said)


def test_a_note_comes_back_from_json_with_the_messages_among_its_values():
    which = Message("maps.far_off_named", {"listed": "a: 3"})
    note = Note("about", "said", "maps.gross_errors", {"count": 2, "which": which})
    content = json.loads(json.dumps(note.to_dict()))
    assert list(content) == ["what", "reason", "code", "values"]
    assert content["values"]["which"] == {
        "code": "maps.far_off_named",
        "values": {"listed": "a: 3"},
    }
    assert Note.from_dict(content) == note


def test_notes_of_earlier_versions_may_lack_their_code():
    old = {"what": "smooth terms", "reason": "150 landings"}
    assert Note.from_dict(old) == Note("smooth terms", "150 landings")
    assert Note.from_dict({"reason": None}) == Note("", "")
