"""The files around the package name only what there is: targets, files, extras, versions.

Every target is run, with programs that do nothing but note that they were called, and heals what was interrupted.
"""

import os
import re
import shutil
import signal
import subprocess
import tomllib
from collections.abc import Callable
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

import pytest
import yaml
from test_experiments import COMPARISONS

from affmap.env.registration import environments
from affmap.experiments import ROOMS

ROOT = Path(__file__).parents[1]
PROJECT: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
MAKEFILE = (ROOT / "Makefile").read_text("utf-8")
HELP = subprocess.run(["make", "--silent", "help"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
TARGETS = set(re.findall(r"^  ([a-z0-9_]+) ", HELP, re.MULTILINE))
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


def test_the_site_is_published_from_where_it_is_built_with_the_least_permissions() -> None:
    """Only the job that publishes may write, and only pages; actions of others are pinned by their major version."""
    pages = yaml.safe_load(text(".github/workflows/pages.yml"))
    build, publish = pages["jobs"]["build"], pages["jobs"]["publish"]
    assert pages["permissions"] == {"contents": "read"} and "permissions" not in build
    assert publish["permissions"] == {"pages": "write", "id-token": "write"}
    assert "secrets" not in text(".github/workflows/pages.yml")
    (folder,) = [step["with"]["path"] for step in build["steps"] if "path" in step.get("with", {})]
    assert f"site_dir: {folder}\n" in text("mkdocs.yml")
    assert [step["run"].removeprefix("make ") in TARGETS for step in build["steps"] if "run" in step] == [True]
    actions = [step["uses"] for job in (build, publish) for step in job["steps"] if "uses" in step]
    assert all(re.fullmatch(r"actions/[\w-]+@v\d+", action) for action in actions)


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
    for target in re.findall(r"\bmake ([a-z0-9_]+)", " ".join(quoted)):
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


def versions(name: str) -> dict[str, str]:
    """Package -> its version in a file of pins."""
    pins = re.findall(r"^([\w.-]+)==([\w.+]+)", text(name), re.MULTILINE)
    return {re.sub(r"[-_.]+", "-", package).lower(): version for package, version in pins}


def test_benchmarks_ask_for_the_pinned_versions() -> None:
    """Else pip finds no way to install both: one package of another version, and `make bench` ends."""
    pinned, asked = versions("constraints.txt"), versions("tests/benchmarks/requirements.txt")
    both = pinned.keys() & asked.keys()
    assert both and {name: asked[name] for name in both} == {name: pinned[name] for name in both}


def test_every_package_of_an_extra_but_those_of_clusters_is_pinned() -> None:
    """What Ray's launcher wants does not go together with the pins (`make slow`)."""
    pinned = versions("constraints.txt").keys()
    for extra in ("dev", "rl", "tensorboard"):
        for requirement in PROJECT["optional-dependencies"][extra]:
            package = re.split(r"[><=\[;]", requirement)[0]
            assert re.sub(r"[-_.]+", "-", package).lower() in pinned, package


CPU_BUILDS = "--extra-index-url https://download.pytorch.org/whl/cpu"
"""PyTorch's own address for builds that pip would not find elsewhere."""


def test_no_file_names_a_registry() -> None:
    """Where packages come from is the user's choice, but for PyTorch's build in the instructions to install."""
    for name in (
        "Dockerfile",
        ".github/workflows/test.yml",
        "Makefile",
        "pyproject.toml",
        "constraints.txt",
        *DOCUMENTS,
    ):
        content = text(name).replace(CPU_BUILDS, "") if name in ("README.md", "docs/install.md") else text(name)
        assert not re.search(r"index-url|--index|pypi\.org|pytorch\.org", content), name


PROGRAM = """#!/bin/sh
echo "${0##*/} $*" >> calls
case "$*" in
  "-m venv "*)
    mkdir -p "$3/bin" && for name in python PROGRAMS; do cp "$0" "$3/bin/$name"; done
    test ! -e stop-venv || { touch "$3/half"; kill -INT 0; sleep 9; }
    touch "$3/bin/pip" ;;
  "-m pip "*)
    test -e "${0%/*}/pip" || exit 1
    case "$*" in
      *" torch") test ! -e stop-torch || { touch "${0%/*}/../half"; kill -INT 0; sleep 9; } ;;
      *"[dev,docs]"*)
        test ! -e stop-tools || { rm "${0%/*}/affmap"; touch "${0%/*}/../half"; kill -INT 0; sleep 9; } ;;
      *"--editable"*) test ! -e stop-package || { touch "${0%/*}/../half"; kill -INT 0; sleep 9; } ;;
    esac ;;
esac
"""
"""Stands for Python and every program of an environment: notes calls, makes environments, is interrupted if asked."""

PROGRAMS = [*PROJECT["scripts"], "ruff", "mypy", "lint-imports"]


@pytest.fixture
def make(tmp_path: Path) -> Callable[..., subprocess.CompletedProcess[str]]:
    """Run make in a folder like the repository, in a process group of its own."""
    for name in ("Makefile", "pyproject.toml", "constraints.txt"):
        shutil.copy(ROOT / name, tmp_path)
    for name in ("affmap", "conf", "tests"):
        (tmp_path / name).symlink_to(ROOT / name)
    (tmp_path / "program").write_text(PROGRAM.replace("PROGRAMS", " ".join(PROGRAMS)))
    (tmp_path / "program").chmod(0o755)
    rest = {name: value for name, value in os.environ.items() if not name.startswith("MAKE")}

    def run(*arguments: str) -> subprocess.CompletedProcess[str]:
        command = ["make", "PYTHON=./program", *arguments]
        options: dict[str, Any] = {"capture_output": True, "text": True, "start_new_session": True, "timeout": 60}
        # A shell starts what is in its background with SIGINT ignored.
        options["preexec_fn"] = lambda: signal.signal(signal.SIGINT, signal.SIG_DFL)
        return subprocess.run(command, cwd=tmp_path, env=rest, check=False, **options)

    return run


def every_target() -> list[str]:
    """All that make knows, as it says itself: those of the help, and each experiment."""
    database = subprocess.run(["make", "-pRrq"], cwd=ROOT, capture_output=True, text=True, check=False).stdout
    (phony,) = re.findall(r"^\.PHONY: (.*)$", database, re.MULTILINE)
    return sorted(phony.split())


SEARCHES = [path.stem for path in (ROOT / "conf/search").glob("*.yaml")]
TESTED = {
    **{f"experiment={name}": "test_experiments.py" for name in (*ROOMS, *COMPARISONS)},
    **{f"search={name}": "config/test_search.py" for name in SEARCHES},
    **{
        "affmap-paper": "test_experiments.py",
        "affmap-play": "play/test_window.py",
        "affmap-publish": "cli/test_run.py",
    },
    **{"tests/benchmarks": "test_benchmarks.py", "tests/benchmarks/gpu.py": "test_gpu.py", "mkdocs": "test_docs.py"},
    **dict.fromkeys(("pytest", "ruff", "mypy", "lint-imports"), ".ci"),
}
"""A word of a command of the Makefile -> the tests that run it at toy size, or `.ci/run`, which runs its target."""


TOOLS = {"mkdocs", "pytest", "ruff", "mypy", "lint-imports"}
"""Programs of the extras [dev] and [docs], which experiments do without."""


@pytest.mark.parametrize("target", every_target())
def test_every_target_runs_commands_that_tests_run(
    make: Callable[..., subprocess.CompletedProcess[str]], tmp_path: Path, target: str
) -> None:
    """The shell's part of each recipe is run as it stands; extras are installed where a command needs them."""
    result = make(target)
    assert result.returncode == 0, result.stderr
    calls = (tmp_path / "calls").read_text().splitlines() if (tmp_path / "calls").exists() else []
    commands = [call for call in calls if not re.match(r"program |python (-m pip|-c) ", call)]
    extras = {
        extra for call in calls for names in re.findall(r"--editable \.\[(.+)\]", call) for extra in names.split(",")
    }
    assert ("dev" in extras) == any(word in TOOLS for each in commands for word in each.split())
    assert ("docs" in extras) == ("dev" in extras and target != "slow")
    assert commands or target in ("help", "setup", "clean")
    for command in commands:
        assert TESTED.keys() & {*command.split()}, command


def calls(folder: Path) -> list[str]:
    """Calls that programs have noted since the last time, without what makes no difference to a result."""
    noted = (folder / "calls").read_text().replace(" --quiet --editable", " --editable").splitlines()
    (folder / "calls").unlink()
    return [
        re.sub(r"^program|-W ignore | --quiet(?= torch)| scale=full| models=train", "", each)
        .replace("-m venv", "python -m venv")
        .strip()
        for each in noted
        if not re.search(r" -c | --version", each)
    ]


def test_commands_for_systems_without_make_are_those_of_make(
    make: Callable[..., subprocess.CompletedProcess[str]], tmp_path: Path
) -> None:
    """The installation line by line, and each row of the table of targets, against what make calls."""
    page = text("docs/install.md")
    (shell,) = re.findall(r"^```powershell\n(.+?)^```", page, re.MULTILINE | re.DOTALL)
    typed = re.findall(r"^(python .+?)(?:  +#.*)?$", shell.replace('"', ""), re.MULTILINE)
    assert make(".venv/.ready-tools").returncode == 0
    assert typed == [*dict.fromkeys(calls(tmp_path))]
    rows = re.findall(r"^\| `make (.+?)` \| (.+?) \|$", page, re.MULTILINE)
    assert len(rows) > 5
    for line, commands in rows:
        assert make(*line.split()).returncode == 0
        assert re.findall(r"`(.+?)`", commands) == calls(tmp_path), line


@pytest.mark.parametrize("line", ["scale=smoke", "SCAL=smoke", "members=2"])
def test_an_unknown_variable_stops_make_before_anything_runs(
    make: Callable[..., subprocess.CompletedProcess[str]], tmp_path: Path, line: str
) -> None:
    """The sentence names all that there are: those that the Makefile gives a value unless the user does."""
    result = make("exp1", "ARGS=seed=3 threads=2", line)
    assert result.returncode == 2 and not (tmp_path / "calls").exists()
    there_are = re.search(r"(\w+) is not a variable of this Makefile; there are: (.*?)\.", result.stderr)
    assert there_are and there_are[1] == line.partition("=")[0]
    assert sorted(there_are[2].split()) == sorted(re.findall(r"^([A-Z]+) \?=", MAKEFILE, re.MULTILINE))


def test_tests_that_run_targets_are_there() -> None:
    """The files of the table, and the targets of `.ci/run`."""
    assert {"make check", "make test"} <= {*text(".ci/run").splitlines()}
    for name in set(TESTED.values()) - {".ci"}:
        assert (ROOT / "tests" / name).is_file()


def test_cleaning_removes_what_make_made_and_nothing_else(
    make: Callable[..., subprocess.CompletedProcess[str]], tmp_path: Path
) -> None:
    """Environments, not runs, in a folder like the repository."""
    (tmp_path / "runs").mkdir()
    before = {*tmp_path.iterdir()}
    for target in ("setup", ".venv-bench/.ready", ".venv-slow/.ready"):
        assert make(target).returncode == 0
    assert {*tmp_path.iterdir()} - before == {
        tmp_path / name for name in (".venv", ".venv-bench", ".venv-slow", "calls")
    }
    assert make("clean").returncode == 0
    assert {*tmp_path.iterdir()} - before == {tmp_path / "calls"} and (tmp_path / "runs").is_dir()


@pytest.mark.parametrize("environment", [".venv", ".venv-bench", ".venv-slow"])
@pytest.mark.parametrize("moment", ["venv", "torch", "package"])
def test_a_first_make_that_was_interrupted_is_healed_by_the_same_command(
    make: Callable[..., subprocess.CompletedProcess[str]], tmp_path: Path, environment: str, moment: str
) -> None:
    """Ctrl-C while the environment is made, without pip yet, and while pip installs: nothing half made is left."""
    folder, target = tmp_path / environment, f"{environment}/.ready"
    (tmp_path / f"stop-{moment}").touch()
    assert make(target).returncode != 0
    assert (folder / "half").exists() and not (folder / ".ready").exists()
    (tmp_path / f"stop-{moment}").unlink()
    result = make(target)
    assert result.returncode == 0, result.stderr
    assert (folder / ".ready").exists() and (folder / "bin/pip").exists()
    assert not (folder / "half").exists() and not (folder / ".unfinished").exists()
    assert "is up to date" in make(target).stdout


def test_an_environment_into_which_another_make_installs_is_left_alone(
    make: Callable[..., subprocess.CompletedProcess[str]], tmp_path: Path
) -> None:
    """The other process is this one; nothing is removed, and no Python is called but for its version."""
    (tmp_path / ".venv").mkdir()
    (tmp_path / ".venv/.ours").touch()
    (tmp_path / ".venv/.unfinished").write_text(f"{os.getpid()}\n")
    result = make("setup")
    assert result.returncode == 2 and "Another make is installing into .venv; run this when" in result.stderr
    assert sorted(path.name for path in (tmp_path / ".venv").iterdir()) == [".ours", ".unfinished"]
    (tmp_path / ".venv/.unfinished").write_text("\n")  # of an interrupted one
    assert make("setup").returncode == 0


@pytest.mark.parametrize("target", ["setup", "test"])
def test_an_environment_whose_tools_were_interrupted_is_made_anew(
    make: Callable[..., subprocess.CompletedProcess[str]], tmp_path: Path, target: str
) -> None:
    """Ctrl-C while pip replaces the package by one with extras: experiments and tests find everything afterwards."""
    assert make("setup").returncode == 0
    (tmp_path / "stop-tools").touch()
    assert make("test").returncode != 0
    assert not (tmp_path / ".venv/bin/affmap").exists()
    (tmp_path / "stop-tools").unlink()
    result = make(target)
    assert result.returncode == 0, result.stderr
    assert "Installing into .venv: " in result.stdout and "some minutes" in result.stdout
    assert (tmp_path / ".venv/bin/affmap").exists() and not (tmp_path / ".venv/half").exists()
    assert (tmp_path / ".venv/.ready-tools").exists() == (target == "test")
    assert "Installing" not in make(target).stdout


def test_an_environment_of_the_user_s_own_is_completed_and_never_removed(
    make: Callable[..., subprocess.CompletedProcess[str]], tmp_path: Path
) -> None:
    """One without pip, as some tools make it, and as an interrupted make of earlier versions left it."""
    for name in ("mine/bin", "mine/package"):
        (tmp_path / name).mkdir(parents=True)
    shutil.copy(tmp_path / "program", tmp_path / "mine/bin/python")
    (tmp_path / "stop-package").touch()
    assert make("setup", "VENV=mine").returncode != 0
    (tmp_path / "stop-package").unlink()
    assert make("setup", "VENV=mine").returncode == 0
    assert (tmp_path / "mine/package").is_dir() and (tmp_path / "mine/.ready").is_file()
    (tmp_path / "stop-tools").touch()
    assert make("check", "VENV=mine").returncode != 0
    (tmp_path / "stop-tools").unlink()
    assert make("check", "VENV=mine").returncode == 0
    assert (tmp_path / "mine/package").is_dir() and (tmp_path / "mine/.ready-tools").is_file()
