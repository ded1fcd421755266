import re

import numpy as np
import pytest
from made_up_files import export
from made_up_hopper import hopping, with_frozen, with_gap, with_spike, with_swap

from hopdata.__main__ import main
from hopdata.inspecting.listing import listing
from hopdata.recordings.readers.formats import read_raw


@pytest.fixture
def clean(tmp_path):
    return export(tmp_path)


@pytest.fixture
def faulty(tmp_path):
    positions = with_swap(hopping(3)[1], "toe1", "toe2", 700, 900)
    positions = with_spike(positions, "hip2", 400, 0.06)
    positions = with_gap(with_gap(positions, "toe3", 1200, 1300), "hip1", 100, 103)
    return export(
        tmp_path, with_frozen(positions, "hip3", 1500, 1530), name="faulty.tsv"
    )


def test_a_clean_file_is_summed_up(clean, capsys):
    assert main(["inspect", str(clean)]) == 0
    out, err = capsys.readouterr()
    for part in (
        "2000 at 100 Hz, 20.0 s",
        "as stated, and with it the markers fall at 9.81 m/s²",
        "7: hip1, hip2, hip3, toe1, toe2, toe3, post",
        "mm: in 32 % of the frames the markers fall at 9.81 m/s²",
        "z: the markers fall along it",
        "hip1, hip2, hip3; 0.62 mm per coordinate by its distances",
        "No swapped or frozen markers",
    ):
        assert part in re.sub(r"\s+", " ", out)
    assert out.count("no gap") == 7
    assert err == ""


def test_the_picture_of_a_long_recording_shows_each_landing(clean, capsys):
    assert main(["inspect", str(clean)]) == 0
    lines = capsys.readouterr().out.splitlines()
    (legend,) = [line for line in lines if line.startswith("  heights")]
    assert "(from 7.5 to 12.5 s; a column is 0.1 s;" in legend
    (toe,) = [line for line in lines if line.startswith("  toe1")]
    heights = toe.split()[1]
    comes_down = sum(
        "▁" not in pair[:1] and pair.endswith("▁") for pair in zip_pairs(heights)
    )
    assert 4 < comes_down < 12
    assert re.search(r"-?0\.0\d to 0\.\d\d m +no gap$", toe)


def zip_pairs(text):
    return [text[k : k + 2] for k in range(len(text) - 1)]


def test_faults_are_listed_by_frame_and_exit_code(faulty, capsys):
    assert main(["inspect", str(faulty)]) == 1
    lines = [re.sub(r"\s+", " ", line) for line in capsys.readouterr().out.splitlines()]
    for part in (
        "3 suspects: 1 spike, 1 swap, 1 frozen marker.",
        "spike frame 401 (4.000 s) hip2 is 60.1 mm off for 1 frame",
        "swap frame 701 (7.000 s) toe1 and toe2 exchanged to frame 900",
        "frozen frame 1501 (15.000 s) hip3 repeats one position in 30 frames",
        "1 gap, longest 100 frames (1 s) at 12 s, 5 % unseen",
    ):
        assert any(part in line for line in lines), part


def test_time_stamps_at_another_rate_than_the_stated_one_are_a_fault(clean, capsys):
    clean.write_text(clean.read_text().replace("FREQUENCY\t100", "FREQUENCY\t50"))
    assert main(["inspect", str(clean)]) == 1
    out = capsys.readouterr().out
    assert "1 wrong frame rate" in out
    assert "the time stamps run at 100 Hz, and the frame rate stated is 50 Hz" in out
    main(["init", str(clean), "-o", str(clean.with_suffix(".yaml"))])
    assert "the frame rate stated is 50 Hz" in clean.with_suffix(".yaml").read_text()


def test_the_picture_shows_a_gap_where_it_is(tmp_path, capsys):
    positions = with_gap(hopping(3)[1], "hip1", 100, 103)[:500]
    main(["inspect", str(export(tmp_path, positions))])
    out = capsys.readouterr().out
    assert re.search(r"hip1 +[▁▂▃▄▅▆▇█]{10}▒[▁▂▃▄▅▆▇█]{39} ", out)
    assert "1 gap, longest 3 frames (0.03 s) at 1 s, 0.6 % unseen" in out


def test_a_terminal_without_these_signs_gets_ascii(faulty):
    from hopdata.recordings.quality.inspection import inspect_recording
    from hopdata.recordings.readers.formats import read_raw

    text = listing(inspect_recording(read_raw(faulty)), "faulty.tsv", encoding="ascii")
    assert text.isascii()
    assert "#####" in text


def test_the_page_is_one_file_with_picture_and_tables(faulty, tmp_path, capsys):
    page = tmp_path / "pages/faulty.html"
    assert main(["inspect", str(faulty), "--html", str(page)]) == 1
    text = page.read_text(encoding="utf-8")
    assert "data:image/svg+xml;base64," in text
    assert not re.search(r'(src|href)="(?!data:|#)', text)
    for part in (
        "toe1 and toe2 exchanged",
        "Rigid clusters",
        "What looks wrong",
        "faulty.tsv",
    ):
        assert part in text
    left, right, *times = map(float, re.search('data-span="([^"]*)"', text)[1].split())
    assert 0 < left < 0.5 < right < 1
    assert times == pytest.approx(read_raw(faulty).time[[0, -1]])
    again = tmp_path / "again.html"
    main(["inspect", str(faulty), "--html", str(again)])
    assert again.read_bytes() == page.read_bytes()


def test_a_page_that_cannot_be_written(clean, tmp_path, capsys):
    assert main(["inspect", str(clean), "--html", str(tmp_path)]) == 1
    assert "expected a file that can be written" in capsys.readouterr().err


def test_what_the_user_knows_is_taken(clean, capsys):
    assert main(["inspect", str(clean), "--unit", "mm", "--vertical-axis", "x"]) in (
        0,
        1,
    )
    out = capsys.readouterr().out
    assert "mm: as given" in out
    assert "x: as given" in out


def test_a_unit_that_cannot_be_is_refused(clean, capsys):
    assert main(["inspect", str(clean), "--unit", "m"]) == 1
    told = capsys.readouterr().err
    assert "--unit: expected mm, in which the markers span" in told
    assert "found m" in told


def test_a_rate_that_the_file_does_not_state(tmp_path, capsys):
    file = export(tmp_path, frequency="EXT", counters=False)
    assert main(["inspect", str(file)]) == 1
    assert "frame rate: expected a number" in capsys.readouterr().err
    assert main(["inspect", str(file), "--rate", "100"]) == 0


def test_mistakes_with_the_file(tmp_path, clean, capsys):
    for name, parts in {
        "munday.tsv": ["expected a file, found none", "did you mean 'monday.tsv'"],
        "monday.xyz": ["expected a file ending in"],
    }.items():
        assert main(["inspect", str(tmp_path / name)]) == 1
        err = capsys.readouterr().err
        assert err.count("\n") == 1
        assert all(part in err for part in parts)


def test_a_marker_that_is_never_seen_is_told_and_no_fault(tmp_path, capsys):
    positions = hopping(2)[1]
    positions[:, 4] = np.nan
    assert main(["inspect", str(export(tmp_path, positions))]) == 0
    assert "never seen" in capsys.readouterr().out


def test_a_marker_unseen_for_long_and_what_the_reader_said_are_noted(tmp_path, capsys):
    positions = hopping(2)[1]
    positions[::2, 4] = np.nan
    positions[np.arange(2000) % 4 > 0, 3] = np.nan
    text = (
        export(tmp_path, positions)
        .read_text()
        .replace("NO_OF_FRAMES\t2000", "NO_OF_FRAMES\t9")
    )
    (tmp_path / "monday.tsv").write_text(text)
    assert main(["inspect", str(tmp_path / "monday.tsv")]) == 0
    told = " ".join(capsys.readouterr().out.split())
    assert (
        "note unseen in many of the frames: toe1 (75 %), toe2 (50 %); that may" in told
    )
    assert "NO_OF_FRAMES: expected 9 frames as stated, found 2000 rows" in told


def test_check_notes_what_inspect_would_list(faulty, clean, tmp_path, capsys):
    config = tmp_path / "study.yaml"
    text = (
        "study: trial\nrecordings:\n  - {{name: one, file: {}}}\n"
        "markers: {{body: [hip1, hip2, hip3], feet: [toe1, toe2, toe3]}}\n"
    )
    config.write_text(text.format(faulty))
    assert main(["check", str(config)]) == 0
    note = next(
        x for x in capsys.readouterr().out.splitlines() if x.startswith("note:")
    )
    assert "3 suspects: 1 spike, 1 swap, 1 frozen marker." in note
    assert " They lie " in note
    assert " between contacts; first hip2 at 4.00 s, toe1 and toe2 at 7.00 s" in note
    config.write_text(text.format(clean))
    assert main(["check", str(config)]) == 0
    assert "note:" not in capsys.readouterr().out


def test_frames_without_an_order_in_time_are_listed_and_cannot_be_used(
    clean, tmp_path, capsys
):
    lines = clean.read_text().splitlines(keepends=True)
    at = next(k for k, line in enumerate(lines) if line.startswith("Frame\t")) + 5
    cells = lines[at].split("\t")
    cells[1] = "0.00000"
    lines[at] = "\t".join(cells)
    clean.write_text("".join(lines))
    assert main(["inspect", str(clean), "--rate", "100"]) == 1
    assert "1 backward time stamp" in capsys.readouterr().out
    page = str(tmp_path / "a.html")
    assert main(["view", str(clean), "--no-browser", "--out", page]) == 1
    assert f"{clean}: time: expected two frames" in capsys.readouterr().err


def test_of_several_files_there_is_a_line_each(clean, faulty, tmp_path, capsys):
    none = tmp_path / "none.tsv"
    assert main(["inspect", str(clean), str(faulty), str(none)]) == 1
    first, second, third = capsys.readouterr().out.splitlines()
    facts = "100 Hz, 20.0 s, 7 markers, z up, mm; feet toe1 toe2 toe3"
    assert re.fullmatch(rf"{clean}: {facts}; \d+ landings", first)
    assert second.startswith(f"{faulty}: {facts}; ")
    assert second.endswith("; 3 suspects")
    assert third.startswith(f"{none}: expected a file, found none")


def test_a_single_file_in_brief_counts_the_landings_that_contacts_finds(clean, capsys):
    assert main(["inspect", str(clean), "--brief"]) == 0
    (line,) = capsys.readouterr().out.splitlines()
    found = int(re.search(r"(\d+) landings", line)[1])
    main(["contacts", str(clean)])
    assert f"contacts in {found} landings" in capsys.readouterr().out
    assert main(["inspect", str(clean)]) == 0
    assert len(capsys.readouterr().out.splitlines()) > 10


def test_what_is_unsure_is_told_in_brief(tmp_path, capsys):
    header = "time," + ",".join(f"{name}_{axis}" for name in "ab" for axis in "xyz")
    rows = [f"{k / 100:.2f},0,0,{k % 7},1,{k % 5},0" for k in range(40)]
    file = tmp_path / "still.csv"
    file.write_text("\n".join([header, *rows]) + "\n")
    main(["inspect", str(file), "--brief"])
    (line,) = capsys.readouterr().out.splitlines()
    assert "no feet found" in line
    assert re.search(r"unsure: .*unit \(\w+ or \w+\)", line)
    main(["inspect", str(file), "--brief", "--unit", "mm"])
    assert "unit (" not in capsys.readouterr().out


def test_a_page_is_of_one_file(clean, faulty, tmp_path, capsys):
    page = tmp_path / "a.html"
    for further in ([str(faulty)], ["--brief"]):
        assert main(["inspect", str(clean), *further, "--html", str(page)]) == 1
        assert "--html: expected one file" in capsys.readouterr().err
    assert not page.exists()
