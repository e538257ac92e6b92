"""One thread: the tests' tensors are small, and two threads on busy cores are many times slower than one."""

import csv
import os
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import stage_files
import torch
from stage_files import WriteGrowth, WriteStages

from affmap import compiled
from affmap.env.layout import Layout

torch.set_num_threads(1)


@pytest.fixture(scope="session")
def write_stages() -> WriteStages:
    """Write every stage of an experiment's sweep; see `stage_files` for the arguments."""
    return stage_files.write_stages


@pytest.fixture(scope="session")
def write_growth() -> WriteGrowth:
    """Write every stage of the longer training of Experiment III; see `stage_files` for the arguments."""
    return stage_files.write_growth


@pytest.fixture(scope="session")
def load_world() -> Callable[[str], Layout]:
    """Read a world from `conf/layout`."""
    return stage_files.load_world


@pytest.fixture(scope="module", params=["compiled", "PyTorch"])
def loops(request: pytest.FixtureRequest) -> Iterator[None]:
    """Either way of computing: compiled loops, or what takes their place without numba."""
    compiled.use(request.param == "compiled")
    yield
    compiled.use(True)


@pytest.fixture
def world() -> Layout:
    """The world of Experiment I."""
    return stage_files.load_world("original")


TRIED = Path(__file__).parents[1] / "docs/tried.csv"
"""Table of the site: attacks on affmap, how often each was tried, and the outcome."""


@pytest.fixture
def tried(record_property: Callable[[str, object], None]) -> Callable[[str, int, str], None]:
    """Record an attack, how often this test tried it, and the outcome, as a row of the site's table."""
    return lambda attack, times, outcome: record_property("tried", (attack, times, outcome))


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--tried", action="store_true", help="write what the tests tried into the site's table")


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session: pytest.Session) -> None:
    """Compare what passed tests tried with the site's table, or renew its rows (in the process that sees all tests)."""
    terminal = session.config.pluginmanager.get_plugin("terminalreporter")
    if hasattr(session.config, "workerinput") or not terminal or "AFFMAP_FUZZ" in os.environ:
        return
    properties = [each for report in terminal.stats.get("passed", []) for each in report.user_properties]
    entries = [value for name, value in properties if name == "tried"]  # others have values of other kinds
    rows = {attack: (str(times), outcome) for attack, times, outcome in entries}
    with TRIED.open(newline="", encoding="utf-8") as file:
        head, *known = csv.reader(file)
    published = {attack: (times, outcome) for attack, times, outcome in known}
    if session.config.getoption("tried"):
        with TRIED.open("w", newline="", encoding="utf-8") as file:
            every = sorted((attack, *row) for attack, row in {**published, **rows}.items())
            csv.writer(file, lineterminator="\n").writerows([head, *every])
    elif different := [attack for attack, row in rows.items() if published.get(attack) != row]:
        terminal.write_line(f"{TRIED.name} says something else of {'; '.join(different)}: make test ARGS=--tried")
        session.exitstatus = session.exitstatus or pytest.ExitCode.TESTS_FAILED
