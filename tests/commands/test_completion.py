"""What bash completes, asked of bash itself."""

import shutil
import subprocess

import pytest

from hopdata.__main__ import main

BASH = shutil.which("bash")
ASK = """
source ./script
COMP_WORDS=({words})
COMP_CWORD=$(( ${{#COMP_WORDS[@]}} - 1 ))
_shtab_hopdata
printf '%s\\n' "${{COMPREPLY[@]}}"
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("completed")
    for name in ("config/monday.yaml", "config/notes.txt", "results/a/verdict.json"):
        (made / name).parent.mkdir(parents=True, exist_ok=True)
        (made / name).touch()
    return made


@pytest.fixture
def completed(folder, capsys):
    """Return what bash offers for the last of some words."""
    assert main(["completion", "bash"]) == 0
    (folder / "script").write_text(capsys.readouterr().out)

    def ask(words):
        command = [BASH, "-c", ASK.format(words=words)]
        ran = subprocess.run(
            command, cwd=folder, capture_output=True, text=True, check=True
        )
        assert ran.stderr == ""
        return ran.stdout.split()

    return ask


@pytest.mark.skipif(BASH is None, reason="no bash")
@pytest.mark.parametrize(
    ("words", "found", "others"),
    [
        ('hopdata ""', {"inspect", "run", "drive"}, {"config"}),
        ('hopdata check ""', {"config/monday.yaml"}, {"config/notes.txt"}),
        ("hopdata run diss", {"dissertation"}, {"config/monday.yaml"}),
        ("hopdata check config/n", {"config/notes.txt"}, {"config/monday.yaml"}),
        ("hopdata run --until pred", {"prediction"}, {"verdict"}),
        ('hopdata plan ""', {"results/a/verdict.json"}, {"results/a"}),
        ("hopdata inspect --ver", {"--vertical-axis"}, {"--unit"}),
    ],
)
def test_bash_completes_what_there_is(completed, words, found, others):
    offered = set(completed(words))
    assert found <= offered
    assert not others & offered


@pytest.mark.parametrize("shell", ["zsh", "tcsh"])
def test_other_shells_know_the_stages(shell, capsys):
    assert main(["completion", shell]) == 0
    assert "poincare_sections" in capsys.readouterr().out
