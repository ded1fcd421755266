from types import SimpleNamespace

import pytest

from hopdata.errors import RecordingError
from hopdata.recording import require_distinct


def source(name, *digests):
    return SimpleNamespace(name=name, place=f"{name}.tsv", source_sha256=", ".join(digests))


def test_different_files_and_those_without_a_file_are_distinct():
    require_distinct([source("a", "1", "2"), source("b", "3"), source("c"), source("d")])


@pytest.mark.parametrize(
    "recordings",
    [
        [source("a", "1", "2"), source("b", "3", "2")],
        [source("b", "2", "2")],
    ],
)
def test_the_same_bytes_under_another_name_are_refused(recordings):
    with pytest.raises(RecordingError, match=r"b\.tsv: .* file 2 of recording 'b' .* count twice"):
        require_distinct(recordings)
