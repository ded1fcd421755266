import ast

import pytest

import hopdata.provenance as module
from hopdata.provenance import code_digest, provenance, stage_digest


def copied_script(tmp_path, text):
    script = tmp_path / "script.py"
    script.write_text(text)
    return script


@pytest.fixture
def forgetful():
    """Clear the caches, so that nothing cached for one package serves another."""

    def forget():
        for remembered in (
            module._imports,
            module._module_files,
            module._modules,
            module._sources,
        ):
            remembered.cache_clear()

    forget()
    yield
    forget()


def imported_names(source):
    """Return the modules that a source imports, by Python's own parser."""
    names = set()
    for node in ast.walk(ast.parse(source.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            names.update(
                [node.module, *(f"{node.module}.{a.name}" for a in node.names)]
            )
    return names


def test_the_pattern_finds_every_import_of_the_package():
    root = module.PACKAGE.parents[1]
    sources = [*module.PACKAGE.rglob("*.py"), *(root / "workflow/scripts").glob("*.py")]
    assert len(sources) > 200
    for source in sources:
        files = {
            path
            for name in imported_names(source)
            for path in module._module_files(name)
        }
        assert files <= module._imports(source), source


@pytest.mark.parametrize(
    "text",
    [
        "import hopdata.landings.floor\n",
        "from hopdata.landings import (\n    density,  # fast (compiled)\n    floor,\n)\n",
        "if True:\n\tfrom hopdata.landings import density, floor as ground\n",
        "import hopdata.errors, hopdata.landings.floor as f\n",
    ],
)
def test_imports_are_found_however_they_are_written(tmp_path, text):
    found = module._imports(copied_script(tmp_path, text))
    assert module.PACKAGE / "landings" / "floor.py" in found


def test_digest_follows_imports_and_only_those(tmp_path):
    lone = code_digest(copied_script(tmp_path, "import numpy\n"))
    floor = code_digest(
        copied_script(tmp_path, "from hopdata.landings.floor import fit_floor\n")
    )
    inner = code_digest(
        copied_script(
            tmp_path, "def f():\n    from hopdata.landings import floor\n    floor\n"
        )
    )
    assert len({lone, floor, inner}) == 3
    again = code_digest(
        copied_script(tmp_path, "from hopdata.landings.floor import fit_floor\n")
    )
    assert again == floor


@pytest.mark.usefixtures("forgetful")
def test_digest_changes_with_a_library_file(tmp_path, monkeypatch):
    package = tmp_path / "hopdata"
    (package / "landings").mkdir(parents=True)
    (package / "__init__.py").write_text("")
    (package / "landings" / "__init__.py").write_text("")
    (package / "landings" / "floor.py").write_text(
        "from hopdata.landings import density\n"
    )
    (package / "landings" / "density.py").write_text("a = 1\n")
    (package / "landings" / "other.py").write_text("a = 1\n")
    monkeypatch.setattr(module, "PACKAGE", package)
    script = copied_script(tmp_path, "from hopdata.landings.floor import fit\n")
    before = code_digest(script)
    (package / "landings" / "other.py").write_text("a = 2\n")
    assert code_digest(script) == before
    (package / "landings" / "density.py").write_text("a = 2\n")
    assert code_digest(script) != before


@pytest.mark.usefixtures("forgetful")
def test_the_digest_of_a_stage_follows_what_its_function_imports(tmp_path, monkeypatch):
    package = tmp_path / "hopdata"
    (package / "landings").mkdir(parents=True)
    files = {
        name: package / name
        for name in ("line.py", "landings/floor.py", "landings/density.py", "stages.py")
    }
    for path in (*files.values(), package / "__init__.py"):
        path.write_text("a = 1\n")
    files["landings/floor.py"].write_text("from hopdata.landings import density\n")
    (package / "landings" / "__init__.py").write_text("")
    monkeypatch.setattr(module, "PACKAGE", package)
    script = copied_script(tmp_path, "from hopdata.stages import LINE\n")
    text = "def level():\n    from hopdata.landings.floor import fit\n    fit()\n"

    def digest(modules=()):
        return stage_digest([text], modules, script=script)

    before = digest()
    files["stages.py"].write_text("another = 'stage'\n")
    assert digest() == before
    assert digest(["hopdata.stages"]) != before
    files["landings/density.py"].write_text("a = 2\n")
    assert digest() != before
    changed = digest()
    files["line.py"].write_text("a = 2\n")
    assert digest() != changed


@pytest.mark.usefixtures("forgetful")
def test_texts_count_for_the_package_that_they_are_in(tmp_path, monkeypatch):
    package = tmp_path / "hopdata"
    for folder in ("", "steering", "steering/commands", "steering/report/templates"):
        (package / folder).mkdir(parents=True)
    for folder in ("", "steering", "steering/commands"):
        (package / folder / "__init__.py").write_text("")
    (package / "steering/model.py").write_text("")
    (package / "steering/commands/drive.py").write_text("")
    command = package / "steering/commands/commands.toml"
    command.write_text("a = 1\n")
    template = package / "steering/report/templates/page.css"
    template.write_text("a\n")

    model = tmp_path / "model.py"
    model.write_text("from hopdata.steering import model\n")
    drive = tmp_path / "drive.py"
    drive.write_text("from hopdata.steering.commands import drive\n")
    monkeypatch.setattr(module, "PACKAGE", package)
    before = code_digest(model)
    before_drive = code_digest(drive)
    command.write_text("a = 2\n")
    assert code_digest(model) == before
    assert code_digest(drive) != before_drive
    template.write_text("b\n")
    assert code_digest(model) != before


def test_provenance_names_seed_inputs_versions_and_times(tmp_path):
    (tmp_path / "level.tsv").write_text("s\th:m:s\n1.25\t0:00:01\n")
    record = provenance(
        {"study": "s", "seed": 3}, {"a.h5": "ff"}, tmp_path.glob("*.tsv")
    )
    assert record["seed"] == 3
    assert record["inputs"] == {"a.h5": "ff"}
    assert record["stage_seconds"] == {"level": 1.25}
    assert record["versions"]["numpy"][0].isdigit()


def test_a_class_that_a_table_names_is_followed():
    """Scenes are loaded by name; whatever simulates depends on all of them."""
    start = module._module_files("hopdata.synthesis.simulate")
    assert module.PACKAGE / "scenes" / "quadruped.py" in module._closure(start)


@pytest.mark.parametrize(
    "content",
    [b"", b"s", b"s\th:m:s\n", b"q\n1.25\n", b"s\nx\n", b"s\n\xff\n", b"s\nnan\n"],
)
def test_a_damaged_file_of_a_time_ends_no_report(tmp_path, content):
    (tmp_path / "level.tsv").write_text("s\th:m:s\n1.25\t0:00:01\n")
    (tmp_path / "damaged.tsv").write_bytes(content)
    config = {"study": "s", "seed": 3}
    record = provenance(config, {"a.h5": "ff"}, tmp_path.glob("*.tsv"))
    assert record["stage_seconds"] == {"level": 1.25}
