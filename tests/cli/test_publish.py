"""Folders of `affmap-publish`; its files are tested in `test_run.py`."""

from pathlib import Path

import pytest

from affmap.config.search import Search
from affmap.config.sweep import Sweep


@pytest.mark.parametrize(
    ("line", "kept"),
    [
        (["experiment=exp1"], "runs/reference/exp1"),
        (["experiment=factors/beta"], "runs/reference/factors/beta"),
        (["experiment=exp1", "output=elsewhere/mine"], "runs/reference/mine"),
        (["experiment=exp1", "store=elsewhere/store", "output=elsewhere/all/mine"], "runs/reference/all/mine"),
        (["experiment=exp1", "reference=kept/store"], "kept/exp1"),
    ],
)
def test_a_report_is_kept_under_the_place_that_it_has_beside_its_store(line: list[str], kept: str) -> None:
    assert Sweep.read(line).first.published == Path(kept)


def test_the_report_of_a_search_is_kept_in_the_same_way() -> None:
    search = Search.read(["search=cem"])
    assert search and search.config.published == Path("runs/reference/tune/cem")
