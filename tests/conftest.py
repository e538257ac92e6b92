"""One thread: the tests' tensors are small, and two threads on busy cores are many times slower than one."""

import csv
import os
import shutil
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
import stage_files
import torch
from stage_files import WriteGrowth, WriteStages

from affmap import compiled
from affmap.env.layout import Layout
from affmap.settings import folder

if TYPE_CHECKING:
    from playwright.sync_api import Browser

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


@pytest.fixture(scope="module")
def browser() -> Iterator["Browser"]:
    """A Chromium of the system, without a window."""
    from playwright.sync_api import sync_playwright

    chromium = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if chromium is None:
        pytest.skip("no Chromium is installed")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        yield browser
        browser.close()


@pytest.fixture
def world() -> Layout:
    """The world of Experiment I."""
    return stage_files.load_world("original")


@pytest.fixture
def own_conf(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the configuration folder, for all that reads it."""
    conf = tmp_path / "conf"
    shutil.copytree(folder(), conf)
    for module in ("affmap.settings.base", "affmap.config.compose"):
        monkeypatch.setattr(f"{module}.folder", lambda: conf)
    monkeypatch.setattr("affmap.settings.base.own_folder", lambda: None)
    return conf


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
    """Compare what passed tests tried with the site's table, or renew it (in the process that sees all tests)."""
    config = session.config
    terminal = config.pluginmanager.get_plugin("terminalreporter")
    if hasattr(config, "workerinput") or not terminal:
        return
    rows: Counter[tuple[str, str]] = Counter()
    for report in terminal.stats.get("passed", []):
        for name, value in report.user_properties:
            if name == "tried":
                attack, times, outcome = value
                rows[attack, outcome] += times
    with TRIED.open(newline="", encoding="utf-8") as file:
        head, *known = csv.reader(file)
    published = {(attack, outcome): int(times) for attack, times, outcome in known}
    if config.getoption("tried"):
        with TRIED.open("w", newline="", encoding="utf-8") as file:
            every = [(attack, times, outcome) for (attack, outcome), times in {**published, **rows}.items()]
            csv.writer(file, lineterminator="\n").writerows([head, *sorted(every, key=lambda row: row[0].lower())])
        return
    is_whole = config.args_source is pytest.Config.ArgsSource.TESTPATHS and not config.option.keyword
    different = [attack for (attack, outcome), times in rows.items() if published.get((attack, outcome)) != times]
    if is_whole and different and "AFFMAP_FUZZ" not in os.environ:
        terminal.write_line(f"\n{TRIED.name} says something else of {'; '.join(different)}: make test ARGS=--tried")
        session.exitstatus = session.exitstatus or pytest.ExitCode.TESTS_FAILED
