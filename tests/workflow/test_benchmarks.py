"""The workflow knows every benchmark: all targets resolve, and figures are drawn."""

import ast
import re
import shlex

import pytest
from benchmark_figures import FIGURES as OF_BENCHMARKS
from benchmark_figures import main as draw
from checkouts import ROOT, completed
from steering_figures import FIGURES as OF_STEERING

from hopdata.figures.catalogue import FIGURES, source_of
from hopdata.products import installed

pytestmark = pytest.mark.workflow

# Those of products stand in folders of their own.
BENCHMARKS = ROOT / "benchmarks"
FOLDERS = [BENCHMARKS, *(BENCHMARKS / one.name for one in installed())]
FILES = sorted(file for folder in FOLDERS for file in folder.glob("*.py"))
DRAWN = {**OF_BENCHMARKS, **OF_STEERING}


def programs():
    """Return the names of the programs with a rule.

    Other files are imported by them, or draw. `constants` takes hours and goes on where
    it was interrupted; its table is a page of the documentation.
    """
    found = {
        file.stem for file in FILES if 'if __name__ == "__main__"' in file.read_text()
    }
    return found - {"benchmark_figures", "steering_figures", "constants"}


@pytest.fixture(scope="module")
def linked(tmp_path_factory):
    """Return a folder like the checkout, without results."""
    folder = tmp_path_factory.mktemp("linked")
    for part in (
        "Snakefile",
        "workflow",
        "config",
        "data",
        "src",
        "benchmarks",
        "tests",
    ):
        (folder / part).symlink_to(ROOT / part)
    return folder


@pytest.fixture(scope="module")
def jobs(linked):
    """Return the rules of a dry run of everything, with the text printed for each."""
    printed = completed(linked, "--dry-run", "--printshellcmds", "benchmarks")
    pieces = re.split(r"^(?:local)?rule (\w+):$", printed, flags=re.MULTILINE)
    return dict(zip(pieces[1::2], pieces[2::2], strict=True))


def test_every_program_has_a_rule(jobs):
    assert len(programs()) >= 12
    rules = {
        name.removeprefix("benchmark_")
        for name in jobs
        if name.startswith("benchmark_")
    }
    assert rules - {"page"} == programs()


def test_every_figure_has_a_rule_and_a_caption(jobs):
    drawn = {
        name.removeprefix("figure_"): jobs[name] for name in jobs if "figure_" in name
    }
    assert set(drawn) == set(DRAWN)
    for figure, text in drawn.items():
        for suffix in ("svg", "png"):
            assert f"results/benchmarks/figures/{figure}.{suffix}" in text
        folder = "benchmarks/steering" if figure in OF_STEERING else "workflow"
        assert f"{folder}/captions/{figure}.md" in jobs["benchmark_page"]


@pytest.mark.parametrize(
    "name", [name for drawings in FIGURES.values() for name in drawings]
)
def test_every_figure_has_a_caption_and_a_function(name):
    captions = [ROOT / "workflow/captions", BENCHMARKS / "steering/captions"]
    captions += [one.rules.with_name("captions") for one in installed()]
    found = [one for one in captions if (one / f"{name}.md").is_file()]
    assert len(found) == (name != "fig2_5_both_sides")
    drawing = next(drawings[name] for drawings in FIGURES.values() if name in drawings)
    assert f"\ndef {drawing.place.partition(':')[2]}(" in source_of(name).read_text()


@pytest.mark.parametrize("program", sorted(programs()))
def test_the_tables_that_a_program_names_are_declared(jobs, program):
    text = next(file for file in FILES if file.stem == program).read_text()
    declared = next(
        x for x in jobs[f"benchmark_{program}"].splitlines() if "output:" in x
    )
    assert f"results/benchmarks/{program}.csv" in declared
    for name in re.findall(r'with_name\(f?"([^"]+)"\)', text):
        assert "results/benchmarks/" + name.replace("{out.stem}", program) in declared


def test_a_program_depends_on_what_it_imports(jobs):
    inputs = next(
        x for x in jobs["benchmark_work_precision"].splitlines() if "input:" in x
    )
    for module in (
        "work_precision",
        "machine",
        "peers/__init__",
        "peers/mujoco_peer",
    ):
        assert f"benchmarks/{module}.py" in inputs
    assert "benchmarks/plate.py" not in inputs
    of_pose = next(x for x in jobs["benchmark_pose"].splitlines() if "input:" in x)
    for module in ("steering/pose", "steering/beside", "machine"):
        assert f"benchmarks/{module}.py" in of_pose


def test_the_digest_of_the_code_is_one_that_snakemake_compares():
    """Snakemake does not rerun a rule for a parameter that is made from inputs."""
    rules = list((ROOT / "workflow" / "rules").glob("*.smk"))
    for file in [*rules, *(product.rules for product in installed())]:
        digests = re.findall(r"^\s+code=(.*)$", file.read_text(), flags=re.MULTILINE)
        assert not [
            one for one in digests if re.match(r"lambda [^:]*\binput\b", one)
        ], file.name


def test_the_figure_rules_draw_and_the_page_shows_them(linked, jobs, monkeypatch):
    """The tables have no rows, which the figures state; the page has every table.

    Snakemake starts one of the rules, which are made in a loop; the commands of the
    others run here.
    """
    tables = {
        "order.csv": "method,max_step,error_rms,in_fit,fitted_order,fitted_error",
        "work_precision.csv": "scene,way,method,setting,error_max,time_median_us",
        "ratios.csv": "scene,way,method,error,best_of_way",
        "side_by_side.csv": "scene,way,method,setting,error_max,time_median_us",
        "side_by_side_ratios.csv": "scene,way,method,error,time_us,ratio,best_of_way",
        "map_error.csv": "states,noise_mm,estimator,landings,median,q05,q95",
        "frame_change_learning.csv": "model,hops,component,rmse,rmse_q05,rmse_q95",
        "frame_change_kernels.csv": "data,reading,smoothness,component,r2,r2_se",
        "adaptation_return.csv": "change,controller,hop,median_m,runs",
        "foot_strikes.csv": "condition,method,bias_ms,sd_ms,order_right",
        "study_cost.csv": "frames,peak_mb,cpu_us_per_frame",
        "verdict_power.csv": "condition,strength,found_share,found_low,found_high",
    }
    results = linked / "results" / "benchmarks"
    results.mkdir(parents=True)
    every = {
        name
        for job in jobs.values()
        for name in re.findall(r"benchmarks/(\w+\.csv)", job)
    }
    for name in every:
        (results / name).write_text(tables.get(name, "nothing") + "\n")
    monkeypatch.chdir(linked)
    for name in set(DRAWN) - {"verdict_power"}:
        command = next(
            x for x in jobs[f"figure_{name}"].splitlines() if ".py" in x and " > " in x
        )
        monkeypatch.setattr(
            "sys.argv", shlex.split(command.split("python ")[1].split(" > ")[0])
        )
        draw(DRAWN)
    page = "results/benchmarks/README.md"
    printed = completed(linked, page, "--rerun-triggers", "mtime")
    assert "2 of 2 steps (100%) done" in printed
    for name in DRAWN:
        assert (linked / f"results/benchmarks/figures/{name}.png").stat().st_size > 1000
    text = (linked / page).read_text()
    assert all(f"](figures/{name}.svg)" in text for name in DRAWN)
    assert all(f"[{name}]({name}):" in text for name in every)


def defined_in(module):
    """Return the names that a module defines or imports at top level, also in `if` or `try`."""
    names = set()
    for node in ast.walk(module):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            names.add(node.name)
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            names.add(node.id)
        elif isinstance(node, ast.Import | ast.ImportFrom):
            names.update(alias.asname or alias.name for alias in node.names)
    return names


@pytest.mark.parametrize("program", FILES, ids=lambda p: p.stem)
def test_what_programs_take_from_each_other_is_there(program):
    """The programs are not run, because some need packages that are extras."""
    for node in ast.walk(ast.parse(program.read_text())):
        if isinstance(node, ast.ImportFrom):
            module = f"{(node.module or '').replace('.', '/')}.py"
            sources = [folder / module for folder in (program.parent, BENCHMARKS)]
            source = next((one for one in sources if one.is_file()), None)
            if source is not None:
                taken = {alias.name for alias in node.names}
                assert taken <= defined_in(ast.parse(source.read_text())), source.name
