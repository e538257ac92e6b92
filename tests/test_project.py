"""The files around the package name only what there is: targets, files, extras, versions."""

import re
import subprocess
import tomllib
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

import pytest
import yaml

from affmap.env.registration import environments

ROOT = Path(__file__).parents[1]
PROJECT: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
MAKEFILE = (ROOT / "Makefile").read_text("utf-8")
HELP = subprocess.run(["make", "--silent", "help"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
TARGETS = set(re.findall(r"^  ([a-z0-9]+) ", HELP, re.MULTILINE))
DOCUMENTS = [
    "README.md",
    "CONTRIBUTING.md",
    "CHANGELOG.md",
    *(f"docs/{path.name}" for path in (ROOT / "docs").glob("*.md")),
]
USERS = {*environments(), "affmap/Mine-v0", "conf/experiment/mine.yaml"}
"""What looks like a file of the repository, and is an environment, or a user's own."""


def text(name: str) -> str:
    return (ROOT / name).read_text("utf-8")


def tracked() -> list[str]:
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True)
    return listed.stdout.splitlines()


def workflow() -> dict[Any, Any]:
    content: dict[Any, Any] = yaml.safe_load(text(".github/workflows/test.yml"))
    return content


def instructions() -> list[tuple[str, list[str]]]:
    """The instructions of the Dockerfile with their words."""
    lines = [line.split() for line in text("Dockerfile").splitlines() if line and not line.startswith("#")]
    return [(line[0], line[1:]) for line in lines]


def test_the_workflow_does_what_ci_run_does() -> None:
    """The same make targets in the same order, all of which there are; on the Pythons that the Makefile accepts."""
    (job,) = workflow()["jobs"].values()
    commands = [step["run"] for step in job["steps"] if "run" in step]
    assert commands == [line for line in text(".ci/run").splitlines() if line.startswith("make")]
    assert {command.removeprefix("make ") for command in commands} <= TARGETS
    pythons = [tuple(map(int, version.split("."))) for version in job["strategy"]["matrix"]["python"]]
    low, high = (tuple(map(int, each)) for each in re.findall(r"\((3), (\d+)\)", MAKEFILE)[:2])
    assert pythons == [(3, minor) for minor in range(low[1], high[1])]
    assert PROJECT["requires-python"] == f">=3.{low[1]}"


def test_the_workflow_needs_no_secret_and_its_cache_depends_on_files_that_there_are() -> None:
    """It may read the repository, and nothing else."""
    assert "secrets" not in text(".github/workflows/test.yml")
    assert workflow()["permissions"] == {"contents": "read"}
    (job,) = workflow()["jobs"].values()
    (cached,) = [step["with"]["cache-dependency-path"].split() for step in job["steps"] if "cache" in str(step)]
    assert cached and set(cached) <= set(tracked())


def test_the_dockerfile_copies_files_that_there_are_and_are_not_ignored() -> None:
    """Tracked, let through by .dockerignore; all that the package is built from is among them."""
    copied = [word for name, words in instructions() if name == "COPY" for word in words[:-1]]
    files = tracked()
    kept = [line.removeprefix("!") for line in text(".dockerignore").splitlines() if line.startswith("!")]
    for source in copied:
        assert any(name == source or name.startswith(f"{source}/") for name in files), source
    assert sorted(kept) == sorted(copied)
    build = tomllib.loads(text("pyproject.toml"))["tool"]["hatch"]["build"]["targets"]["wheel"]
    needed = {*build["packages"], *build["force-include"], PROJECT["readme"], *PROJECT["license-files"]}
    assert all(any(path == source or path.startswith(f"{source}/") for source in copied) for path in needed)


def test_the_dockerfile_installs_a_pinned_torch_first_as_make_does() -> None:
    """By hand: torch, then the package, both under the constraints; then a command that the package has."""
    installed = [words[4:] for name, words in instructions() if name == "RUN" and words[2:4] == ["pip", "install"]]
    assert installed == [["torch"], ["."]]
    names = [name for name, _ in instructions()]
    assert names.index("COPY") < names.index("RUN") and "PIP_CONSTRAINT=/src/constraints.txt" in text("Dockerfile")
    (image,) = [words[0] for name, words in instructions() if name == "FROM"]
    assert (
        image.removeprefix("python:").removesuffix("-slim")
        in workflow()["jobs"]["test"]["strategy"]["matrix"]["python"]
    )
    assert instructions()[-1] == ("CMD", ['["affmap",', '"--help"]'])
    assert "affmap" in PROJECT["scripts"]


@pytest.mark.parametrize("name", DOCUMENTS)
def test_documents_name_targets_files_and_extras_that_there_are(name: str) -> None:
    """Everything in backticks that looks like one of them; files that commands make, or users would, do not count."""
    quoted = re.findall(r"`([^`\n]+)`", text(name))
    for target in re.findall(r"\bmake ([a-z0-9]+)", " ".join(quoted)):
        assert target in TARGETS, target
    files = tracked()
    for path in quoted:
        if re.fullmatch(r"(affmap|conf|tests|hydra_plugins|\.ci)/[\w./-]+", path) and path not in USERS:
            assert any(fnmatch(file, f"{path.rstrip('/')}*") for file in files), path
    for extra in re.findall(r"\[([a-z]+)\]", " ".join(quoted)):
        assert extra in PROJECT["optional-dependencies"], extra


def test_versions_agree() -> None:
    """The package's, the citation's, and the newest of the changelog."""
    citation = yaml.safe_load(text("CITATION.cff"))
    newest = re.findall(r"^## \[(.+?)\]", text("CHANGELOG.md"), re.MULTILINE)[0]
    assert str(citation["version"]) == newest == PROJECT["version"]
    assert citation["license"] == PROJECT["license"] and citation["title"] == PROJECT["name"]


def test_every_package_of_an_extra_but_those_of_clusters_is_pinned() -> None:
    """What Ray's launcher wants does not go together with the pins (`make slow`)."""
    pinned = {re.sub(r"[-_.]+", "-", line.partition("==")[0]).lower() for line in text("constraints.txt").split()}
    for extra in ("dev", "rl", "tensorboard"):
        for requirement in PROJECT["optional-dependencies"][extra]:
            package = re.split(r"[><=\[;]", requirement)[0]
            assert re.sub(r"[-_.]+", "-", package).lower() in pinned, package


def test_no_file_names_a_registry() -> None:
    """Where packages come from is the user's choice."""
    for name in (
        "Dockerfile",
        ".github/workflows/test.yml",
        "Makefile",
        "pyproject.toml",
        "constraints.txt",
        *DOCUMENTS,
    ):
        assert not re.search(r"index-url|--index|pypi\.org|pytorch\.org", text(name)), name
