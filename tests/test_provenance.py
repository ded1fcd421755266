import pytest

from hopdata.provenance import code_digest, provenance


def copied_script(tmp_path, text):
    script = tmp_path / "script.py"
    script.write_text(text)
    return script


def forget_sources(module):
    for remembered in (module._imports, module._module_files, module._sources):
        remembered.cache_clear()


@pytest.mark.parametrize(
    "text",
    [
        "import hopdata.landings.floor\n",
        "from hopdata.landings import (\n    density,\n    floor,  # both\n)\n",
        "if True:\n\tfrom hopdata.landings import density, floor as ground\n",
        "import hopdata.errors, hopdata.landings.floor as f\n",
    ],
)
def test_imports_are_found_however_they_are_written(tmp_path, text):
    import hopdata.provenance as module

    found = module._imports(copied_script(tmp_path, text))
    assert module.PACKAGE / "landings" / "floor.py" in found


def test_digest_follows_imports_and_only_those(tmp_path):
    lone = code_digest(copied_script(tmp_path, "import numpy\n"))
    floor = code_digest(copied_script(tmp_path, "from hopdata.landings.floor import fit_floor\n"))
    inner = code_digest(
        copied_script(tmp_path, "def f():\n    from hopdata.landings import floor\n    floor\n")
    )
    assert len({lone, floor, inner}) == 3
    again = code_digest(copied_script(tmp_path, "from hopdata.landings.floor import fit_floor\n"))
    assert again == floor


def test_digest_changes_with_a_library_file(tmp_path, monkeypatch):
    import hopdata.provenance as module

    package = tmp_path / "hopdata"
    (package / "landings").mkdir(parents=True)
    (package / "__init__.py").write_text("")
    (package / "landings" / "__init__.py").write_text("")
    (package / "landings" / "floor.py").write_text("from hopdata.landings import density\n")
    (package / "landings" / "density.py").write_text("a = 1\n")
    (package / "landings" / "other.py").write_text("a = 1\n")
    monkeypatch.setattr(module, "PACKAGE", package)
    forget_sources(module)
    script = copied_script(tmp_path, "from hopdata.landings.floor import fit\n")
    before = code_digest(script)
    (package / "landings" / "other.py").write_text("a = 2\n")
    assert code_digest(script) == before
    (package / "landings" / "density.py").write_text("a = 2\n")
    assert code_digest(script) != before
    forget_sources(module)


def test_provenance_names_seed_inputs_versions_and_times(tmp_path):
    (tmp_path / "level.tsv").write_text("s\th:m:s\n1.25\t0:00:01\n")
    record = provenance({"study": "s", "seed": 3}, {"a.h5": "ff"}, tmp_path.glob("*.tsv"))
    assert record["seed"] == 3
    assert record["inputs"] == {"a.h5": "ff"}
    assert record["stage_seconds"] == {"level": 1.25}
    assert record["versions"]["numpy"][0].isdigit()
