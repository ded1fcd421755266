"""Errors of other packages' code: one line, with the name of the package."""

import subprocess
import sys
from importlib.metadata import EntryPoint

import pytest

from hopdata import products, scenes
from hopdata.errors import AnalysisError, ConfigError
from hopdata.foreign.plugins import blamed, name_of

STUDY = """study: a
markers: {body: [a, b, c], feet: [d, e]}
recordings: [{name: a}]
simulation: {scene: broken}
"""


@pytest.fixture
def environment(tmp_path):
    """Install a package with a scene and two products that do not work."""
    places = {
        "odd/__init__.py": "",
        "odd/scene.py": "raise RuntimeError('two\\nlines')",
        "odd/sub/__init__.py": "raise ValueError('no')",
        "worse/__init__.py": "",
        "worse/commands/commands.toml": "[commands",
        "odd_pkg-1.0.dist-info/METADATA": "Metadata-Version: 2.1\nName: odd-pkg\nVersion: 1.0\n",
        "odd_pkg-1.0.dist-info/entry_points.txt": "[hopdata.scenes]\nbroken = odd.scene:Scene\n"
        "[hopdata.products]\nbad = odd.sub.deeper\nbadtoml = worse\n",
        "study.yaml": STUDY,
    }
    for name, content in places.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(content)
    return tmp_path


def test_a_broken_package_is_named_and_stops_no_other_command(environment):
    def hopdata(*words):
        code = f"import sys; sys.path.insert(0, {str(environment)!r})\n"
        code += (
            "from hopdata.__main__ import main\nraise SystemExit(main(sys.argv[1:]))"
        )
        return subprocess.run(
            [sys.executable, "-c", code, *words],
            capture_output=True,
            text=True,
            check=False,
        )

    refused = hopdata("check", str(environment / "study.yaml"))
    lines = refused.stderr.splitlines()
    assert refused.returncode == 1
    assert len(lines) == 3
    assert all("odd-pkg" in line for line in lines)
    assert "(odd.scene:Scene) to work, found RuntimeError: two lines" in lines[2]
    fine = hopdata("completion", "bash")
    assert fine.returncode == 0
    assert "hopdata" in fine.stdout
    assert len(fine.stderr.splitlines()) == 2


def test_what_a_plugin_raises_is_blamed_on_it():
    entry = EntryPoint("odd", "odd.scene:Scene", "hopdata.scenes")
    name = name_of("scene", entry)
    for error in (KeyError("x"), SystemExit(3)):
        with (
            pytest.raises(
                ConfigError, match="the scene 'odd' of the package"
            ) as caught,
            blamed(name, "simulation.scene"),
        ):
            raise error
        assert caught.value.code == "foreign.plugin"
        assert caught.value.__cause__ is error
    with pytest.raises(AnalysisError, match=r"^its own$"), blamed(name, "a"):
        raise AnalysisError("its own")
    with pytest.raises(KeyboardInterrupt), blamed(name, "a"):
        raise KeyboardInterrupt


def test_errors_of_our_own_scenes_keep_their_traceback():
    with pytest.raises(ZeroDivisionError), scenes.blamed_scene("hopper"):
        raise ZeroDivisionError
    for product in products.installed():
        with pytest.raises(ZeroDivisionError), product.blamed():
            raise ZeroDivisionError
