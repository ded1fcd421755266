"""Write what follows from the stages: rules, two tables, and their picture.

    python packaging/rules.py        writes them in a checkout (`make rules`)

`hopdata.stages` tells each stage once. A test compares the files with what would be
written now.
"""

from collections.abc import Iterator
from pathlib import Path

import graph
import keys

from hopdata.line import RECORDING, Key, Line, Result, Stage
from hopdata.stages import LINE

CHECKOUT = Path(__file__).parents[1]
HEAD = """\
# Written by `make rules` from src/hopdata/stages.py, which tells each stage once:
# edit that file. A rule calls the function of its name there. It states every file
# that is read and written, and every key of the configuration (STUDY) that is taken.\
"""
SCRIPT = "../scripts/stage.py"


def written() -> dict[Path, str]:
    """Return the files that follow from the stages, and what they should hold."""
    architecture = CHECKOUT / "docs" / "architecture.md"
    results = CHECKOUT / "docs" / "results.md"
    return {
        CHECKOUT / "workflow" / "rules" / "line.smk": rules_text(LINE),
        CHECKOUT / "docs" / "rules.svg": graph.drawing(LINE),
        architecture: _with_table(architecture, "rules", line_table(LINE)),
        results: _with_table(results, "keys", keys.table(LINE)),
    }


def _with_table(page: Path, name: str, table: str) -> str:
    """Return a page with a table between the two comments that mark its place."""
    begin = f"<!-- {name}: written by `make rules` -->\n"
    end = f"<!-- end of {name} -->"
    before, _, rest = page.read_text(encoding="utf-8").partition(begin)
    _, _, after = rest.partition(end)
    return f"{before}{begin}{table}\n{end}{after}"


# Rules.


def rules_text(line: Line) -> str:
    """Return the rules of all stages, as snakefmt formats them."""
    rules = [_rule(line, stage) for stage in line.stages.values()]
    return HEAD + "\n" + "\n\n".join(rules)


def _rule(line: Line, stage: Stage) -> str:
    wildcards = "".join(f"_{{{{{wildcard}}}}}" for wildcard in stage.per)
    job = f"{stage.name}{wildcards}"
    inputs = [*_inputs(line, stage)]
    outputs = [*_outputs(stage)]
    minutes = stage.needs.minutes
    memory = stage.needs.mb_a_mb
    text = [f"rule {stage.name}:", f'    """{stage.summary}"""']
    if inputs:
        text += _block("input", inputs)
    text += _block("output", outputs)
    text += _block("log", [f'f"{{RESULTS}}/logs/{job}.log"'])
    text += ["    benchmark:", f'        f"{{RESULTS}}/benchmarks/{job}.tsv"']
    if stage.needs.priority:
        text += [f"    priority: {stage.needs.priority}"]
    text += _block("resources", [f"**needs(minutes={minutes}, mb_a_mb={memory})"])
    text += _block("params", [*_params(stage)])
    text += ["    script:", f'        "{SCRIPT}"']
    return "\n".join(text) + "\n"


def _block(name: str, entries: list[str]) -> list[str]:
    return [f"    {name}:", *(f"        {entry}," for entry in entries)]


def _inputs(line: Line, stage: Stage) -> Iterator[str]:
    for name in stage.sources:
        yield f"{name}=source_files"
    for name in stage.inputs:
        result = line.results[name]
        path = _path(result)
        free = result.wildcards - {*stage.per}
        if RECORDING in free:
            path = f"each_recording({path})"
        if "method" in free:  # the labels of the method that the study chose
            path = path.replace("{{method}}", "{METHOD}")
        yield f"{name}={path}"


def _outputs(stage: Stage) -> Iterator[str]:
    for result in stage.results.values():
        path = _path(result)
        if stage.makes_all(result):
            path = f"each_recording({path})"
        yield f"{result.name}={path}"


def _path(result: Result) -> str:
    """Return the text of a path, with two braces, as the rule formats it."""
    path = result.path.replace("{", "{{").replace("}", "}}")
    return f'f"{{RESULTS}}/{path}"'


def _params(stage: Stage) -> Iterator[str]:
    yield f'stage="{stage.name}"'
    for name, setting in stage.keys.items():
        yield f"{name}={_value(stage, setting)}"
    if stage.sources:
        yield "stamps=source_stamps"
    yield f'code=stage_code("{stage.name}")'


def _value(stage: Stage, setting: Key) -> str:
    """Return the expression by which a rule takes a setting from the configuration."""
    of_this_recording = setting.of_each_recording and RECORDING in stage.per
    if callable(setting.of):
        module = setting.of.__module__.rpartition(".")[2]
        function = f"{module}.{setting.of.__name__}"
        if of_this_recording:
            return f"lambda wildcards: {function}(STUDY, wildcards.recording)"
        return f"{function}(STUDY)"
    parts = setting.of.split(".")
    if of_this_recording:
        return f'lambda wildcards: in_recordings("{parts[1]}")[wildcards.recording]'
    if setting.of_each_recording:
        return f'in_recordings("{parts[1]}")'
    value = "STUDY" + "".join(f'["{part}"]' for part in parts)
    if setting.without:
        left_out = ", ".join(f'"{name}"' for name in setting.without)
        return f"all_but({value}, {left_out})"
    return value


def line_table(line: Line) -> str:
    """Return the stages as a table in Markdown, for the page on the architecture."""
    rows = ["| rule | what it does | takes from | makes |", "|---|---|---|---|"]
    for stage in line.stages.values():
        makers = ", ".join(f"`{name}`" for name in line.before(stage.name))
        if stage.sources:
            makers = f"a file of any format, or {makers}"
        files = ", ".join(f"`{one.path}`" for one in stage.results.values())
        what = stage.summary.removesuffix(".")
        rows.append(f"| `{stage.name}` | {what} | {makers or 'the keys'} | {files} |")
    return "\n".join(rows)


if __name__ == "__main__":
    for path, text in written().items():
        path.write_text(text, encoding="utf-8")
        print(f"{path.relative_to(CHECKOUT)}: written")
