"""What comes from elsewhere is named by commit, digest or hash, and its licence is stated."""

import importlib.util
import json
import re
import subprocess
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path, PurePosixPath

import pytest
import yaml

ROOT = Path(__file__).parents[1]
WORKFLOWS = sorted((ROOT / ".github/workflows").glob("*.yml"))


def of_packaging(name):
    """Import a program of the folder packaging, whose name is that of a library too."""
    place = ROOT / "packaging" / f"{name}.py"
    spec = importlib.util.spec_from_file_location(f"hopdata_{name}", place)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


pins = of_packaging("pins")
sbom = of_packaging("sbom")


def test_actions_are_named_by_commit():
    found = [pin for path in WORKFLOWS for pin in pins.pins(path.read_text("utf-8"))]
    assert len(found) > 10
    # One commit for each tag.
    assert len({(action, tag) for action, _, tag in found}) == len(set(found))


@pytest.mark.parametrize(
    "uses",
    [
        "actions/checkout@v4",
        "actions/checkout@11bd719  # v4.2.2",
        "actions/checkout@11bd71901bbe5b1630ceea73d27597364c9af683",
    ],
)
def test_an_action_that_can_be_moved_is_refused(uses):
    with pytest.raises(ValueError, match="owner/action@commit"):
        pins.pins(f"      - uses: {uses}\n")


def test_a_moved_tag_is_found(tmp_path, monkeypatch, capsys):
    """A repository on this machine stands for the actions' host."""

    def git(*words):
        run = subprocess.run(
            ["git", "-C", str(place), "-c", "user.name=a", "-c", "user.email=a@b", *words],
            check=True, capture_output=True, encoding="utf-8",
        )  # fmt: skip
        return run.stdout.strip()

    place = tmp_path / "owner" / "action"
    place.mkdir(parents=True)
    git("init", "-q")
    git("commit", "-q", "--allow-empty", "-m", "one")
    git("tag", "-a", "v1.0", "-m", "annotated")
    commit = git("rev-parse", "HEAD")
    host = f"{tmp_path}/"
    assert pins.commit_of("owner/action", "v1.0", host) == commit
    workflows = tmp_path / "workflows"
    workflows.mkdir()
    (workflows / "a.yml").write_text(f"- uses: owner/action@{commit}  # v1.0\n")
    monkeypatch.setattr(pins, "WORKFLOWS", workflows)
    ask = pins.commit_of
    monkeypatch.setattr(pins, "commit_of", lambda *pin: ask(*pin, host))
    assert pins.main() == 0
    git("commit", "-q", "--allow-empty", "-m", "two")
    git("tag", "-f", "v1.0")
    assert pins.main() == 1
    assert f"expected v1.0 at {commit}, found {git('rev-parse', 'HEAD')}" in (
        capsys.readouterr().out
    )


def test_jobs_may_write_nothing_but_what_they_say():
    """A token that writes is given to the release alone, to sign and to publish."""
    for path in WORKFLOWS:
        workflow = yaml.safe_load(path.read_text("utf-8"))
        assert workflow["permissions"] == {"contents": "read"}
        written = {
            (name, what)
            for name, job in workflow["jobs"].items()
            for what, right in job.get("permissions", {}).items()
            if right == "write"
        }
        allowed = {
            ("build", "id-token"),
            ("build", "attestations"),
            ("publish", "id-token"),
        }
        assert written == (allowed if path.stem == "release" else set())


def test_the_release_attests_what_it_publishes():
    release = (ROOT / ".github/workflows/release.yml").read_text("utf-8")
    steps = yaml.safe_load(release)["jobs"]["build"]["steps"]
    used = {
        step["uses"].split("@")[0]: step.get("with") for step in steps if "uses" in step
    }
    attested = used["actions/attest-build-provenance"]["subject-path"].split()
    assert attested == ["dist/hopdata-*", "dist/hopdata_hybrid-*"]
    listed = used["actions/attest-sbom"]["sbom-path"]
    assert listed == "dist/hopdata.cdx.json"
    assert f"packaging/sbom.py {listed}" in (ROOT / "Makefile").read_text("utf-8")


def test_images_are_named_by_digest():
    image = (ROOT / "Dockerfile").read_text("utf-8")
    bases = re.findall(r"^FROM (\S+)", image, re.MULTILINE)
    digest = re.fullmatch(r"python:3\.13\.\d+-slim-\w+@(sha256:[0-9a-f]{64})", *bases)
    assert digest
    workflow = (ROOT / "Snakefile").read_text("utf-8")
    assert f'container: "docker://python@{digest[1]}"' in workflow


def installations(text):
    """Return each command of pip in a text, with the lines that continue it."""
    joined = text.replace("\\\n", " ")
    commands = re.findall(r"(?:\bpip|\$\$pip) (?:install )?(-[^&;\n]*)", joined)
    return [one for one in commands if re.search(r" -r |-e | \.|\$\$file", one)]


def is_locked(command):
    return "--require-hashes" in command or "--no-deps" in command


@pytest.mark.parametrize("name", ["Makefile", "Dockerfile", *map(str, WORKFLOWS)])
def test_the_locks_are_the_only_way_in(name):
    found = installations((ROOT / name).read_text("utf-8"))
    loose = [command for command in found if not is_locked(command)]
    # The weekly run against the newest versions is made to find what the locks do not hold.
    assert loose == (['-e ".[test]"'] if name.endswith("tests.yml") else [])
    assert found or name.endswith("release.yml")


# Files of the project itself that hold nothing of others.
OWN = {
    *(".dockerignore", ".git-blame-ignore-revs", ".gitignore", "run", "CITATION.cff"),
    *("Dockerfile", "LICENSE", "Makefile", "Snakefile", ".zenodo.json", "py.typed"),
}


def test_every_bundled_file_has_its_licence_on_the_page():
    listed = subprocess.run(
        ["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=True
    )
    text = {"py", "pyi", "md", "yaml", "yml", "smk", "lock", "sh", "tsv"}
    patterns = re.findall(
        r"`([^`]+)`",
        (ROOT / "docs/licences.md").read_text("utf-8").partition("## Locked")[0],
    )
    assert "data/sample/*.h5" in patterns
    unlisted = []
    for name in listed.stdout.decode("utf-8").split("\0")[:-1]:
        path = PurePosixPath(name)
        own = (
            path.suffix.lstrip(".") in text
            or path.name in OWN
            or path.suffix == ".toml"
        )
        has_data = "coefficients" in path.stem and path.suffix == ".toml"
        if own and not has_data:
            continue
        if not any(path.match(pattern) for pattern in patterns):
            unlisted.append(name)
    assert unlisted == []


def is_installed(part):
    """Tell whether this version of a package is installed; another may be under another licence."""
    try:
        return version(part.name) == part.version
    except PackageNotFoundError:
        return False


def test_the_licences_of_all_that_is_locked_are_stated():
    known = sbom.page_licences()
    locked = [part for lock in sbom.LOCKS for part in sbom.parts(lock)]
    assert len(locked) > 80
    assert set(known) == {part.name for part in locked}
    compared = 0
    for part in locked:
        if is_installed(part):
            compared += 1
            assert sbom.stated_licence(part.name) == known[part.name], part.name
    assert compared > 50
    # None of them asks more of who distributes hopdata than a notice.
    copyleft = {name for name, licence in known.items() if "GPL" in licence}
    assert copyleft == {"docutils"}  # a few of its files, which hopdata does not use


def test_the_list_of_parts_is_whole_and_the_same_each_time(tmp_path):
    out = tmp_path / "a.json"
    sbom.main([str(out)])
    first = out.read_bytes()
    sbom.main([str(out)])
    assert out.read_bytes() == first
    parts = json.loads(first)
    assert (parts["bomFormat"], parts["specVersion"]) == ("CycloneDX", "1.6")
    locked = {
        f"pkg:pypi/{part.name}@{part.version}"
        for lock in sbom.LOCKS
        for part in sbom.parts(lock)
    }
    assert {part["purl"] for part in parts["components"]} == locked
    assert len(parts["components"]) == len(locked)
    for part in parts["components"]:
        assert any(one["name"] == "hopdata:file:sha256" for one in part["properties"])
    needed = parts["dependencies"][0]["dependsOn"]
    assert any(purl.startswith("pkg:pypi/numpy@") for purl in needed)
    assert set(needed) <= locked
