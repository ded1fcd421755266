"""What is true of many files of a folder is told once."""

from hopdata.commands.remarks import LEAST_FILES, Remark, told_together


def of_files(texts, folder="box"):
    return [Remark(f"{folder}/{k}.c3d", text) for k, text in enumerate(texts, start=1)]


def test_a_remark_on_all_files_of_a_folder_is_told_once_with_their_number():
    told = told_together(of_files(["no unit is stated"] * 24))
    assert told == ["24 files of box (1.c3d, 2.c3d, 3.c3d, 21 more): no unit is stated"]


def test_remarks_that_differ_in_numbers_alone_are_told_with_those_of_the_first():
    texts = [f"falls in {share}.5 % of the frames" for share in (10, 20, 30)]
    (told,) = told_together(of_files(texts))
    assert told == (
        "3 files of box (1.c3d, 2.c3d, 3.c3d): alike but for numbers; the first: "
        "falls in 10.5 % of the frames"
    )


def test_other_remarks_other_folders_and_few_files_stay_as_they_are():
    few = of_files(["a"] * (LEAST_FILES - 1))
    others = [*few, *of_files(["a"], "other"), *of_files(["b"]), Remark("", "c")]
    assert told_together(others) == [str(one) for one in others]
    assert str(others[-1]) == "c"


def test_several_remarks_on_one_file_are_not_of_several_files():
    remarks = [Remark("box/1.c3d", f"gap at {k} s") for k in range(LEAST_FILES)]
    assert told_together(remarks) == [str(one) for one in remarks]


def test_a_place_that_a_text_begins_with_is_not_told_twice():
    assert str(Remark.of("box/1.c3d", "box/1.c3d: odd")) == "box/1.c3d: odd"
    assert Remark.of("box/1.c3d", "odd") == Remark("box/1.c3d", "odd")
