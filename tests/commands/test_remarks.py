"""What is true of many files of a folder is told once."""

from hopdata.commands.remarks import LEAST_FILES, Remark, told_together
from hopdata.messages import Message


def of_files(texts, folder="box"):
    return [Remark(f"{folder}/{k}.c3d", text) for k, text in enumerate(texts, start=1)]


def few_of(percent, foot="toe1"):
    """Return a message with a number and a name."""
    return Message("commands.foot_makes_unsure", {"foot": foot, "percent": percent})


def test_a_remark_on_all_files_of_a_folder_is_told_once_with_their_number():
    told = told_together(of_files(["no unit is stated"] * 24))
    assert told == ["24 files of box (1.c3d, 2.c3d, 3.c3d, 21 more): no unit is stated"]


def test_remarks_that_differ_in_numbers_alone_are_told_with_those_of_the_first():
    texts = [few_of(10), few_of(20), few_of(30)]
    (told,) = told_together(of_files(texts))
    assert told == (
        "3 files of box (1.c3d, 2.c3d, 3.c3d): alike but for numbers; the first: "
        f"{few_of(10)}"
    )


def test_messages_are_alike_by_code_and_values_and_words_only_if_the_same():
    of_feet = [few_of(10, foot) for foot in ("toe1", "toe2", "toe3")]
    in_words = [str(few_of(share)) for share in (10, 20, 30)]
    for texts in (of_feet, in_words):
        remarks = of_files(texts)
        assert told_together(remarks) == [str(one) for one in remarks]


def test_messages_that_name_their_own_file_are_alike():
    texts = [
        Message("commands.see_inspect", {"answer": f"{folder}{k}.c3d"})
        for k, folder in enumerate(("", "box/", ""), start=1)
    ]
    assert len(told_together(of_files(texts))) == 1


def test_other_remarks_other_folders_and_few_files_stay_as_they_are():
    few = of_files(["a"] * (LEAST_FILES - 1))
    others = [*few, *of_files(["a"], "other"), *of_files(["b"]), Remark("", "c")]
    assert told_together(others) == [str(one) for one in others]
    assert str(others[-1]) == "c"


def test_several_remarks_on_one_file_are_not_of_several_files():
    remarks = [Remark("box/1.c3d", f"gap at {k} s") for k in range(LEAST_FILES)]
    assert told_together(remarks) == [str(one) for one in remarks]


def test_a_place_that_a_text_begins_with_is_not_told_twice():
    assert str(Remark("box/1.c3d", "box/1.c3d: odd")) == "box/1.c3d: odd"
    assert str(Remark("box/1.c3d", "odd")) == "box/1.c3d: odd"
