"""The command line: help with examples and exit codes, and suggestions for misspelt commands."""

import pytest

from hopdata.__main__ import main


def ended(arguments, capsys):
    with pytest.raises(SystemExit) as caught:
        main(arguments)
    return caught.value.code, *capsys.readouterr()


@pytest.mark.parametrize(
    "command",
    [[], ["inspect"], ["init"], ["check"], ["run"], ["plan"], ["config-docs"]],
)
def test_help_has_examples_and_exit_codes(command, capsys):
    code, out, _ = ended([*command, "--help"], capsys)
    assert code == 0
    assert "exit codes:" in out
    assert "hopdata inspect monday.tsv" in out or "examples:" in out


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        (
            ["insepct", "x"],
            [
                "expected one of inspect, view, contacts, init, check, run, plan",
                "did you mean 'inspect'?",
            ],
        ),
        (["inspect"], ["the following arguments are required: FILE"]),
        (["inspect", "x.tsv", "--unit", "cm"], ["expected one of mm, m", "found 'cm'"]),
        (
            ["inspect", "x.tsv", "--rate", "-5"],
            ["expected a number above 0, found '-5'"],
        ),
        (
            ["inspect", "x.tsv", "--rate", "fast"],
            ["expected a number above 0, found 'fast'"],
        ),
        (
            ["init", "x.tsv", "--vertical-axis", "up"],
            ["expected one of x, y, z, -x, -y, -z", "found 'up'"],
        ),
    ],
)
def test_a_wrong_command_line_is_told_with_exit_code_2(arguments, parts, capsys):
    code, out, err = ended(arguments, capsys)
    assert code == 2
    assert out == ""
    for part in parts:
        assert part in err
