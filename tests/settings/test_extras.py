"""Extras as pyproject.toml has them."""

import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from affmap.settings import extras

EXTRAS = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text("utf-8"))["project"][
    "optional-dependencies"
]


@pytest.mark.parametrize("extra", EXTRAS)
def test_the_requirements_of_an_extra_are_those_of_the_project(extra: str) -> None:
    """As the installed package says, in any order and spelling."""
    assert {*map(Requirement, extras.requirements(extra))} == {*map(Requirement, EXTRAS[extra])}


def test_a_missing_extra_is_told_with_a_command_that_names_its_packages(monkeypatch: pytest.MonkeyPatch) -> None:
    """Golden sentences; from a clone that is only on the path, the name of the extra has to do."""
    assert extras.missing("--output a.mp4", "video") == (
        '--output a.mp4 needs a package that is not installed: pip install "imageio[ffmpeg]>=2.35"'
    )
    assert extras.requirements("vide") == extras.requirements("nope") == []

    def requires(name: str) -> list[str]:
        raise extras.PackageNotFoundError(name)

    monkeypatch.setattr(extras, "requires", requires)
    assert extras.missing("It", "wandb") == 'It needs a package that is not installed: pip install "wandb"'
