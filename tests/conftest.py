"""One thread: the tests' tensors are small, and two threads on busy cores are many times slower than one."""

from collections.abc import Callable, Iterator

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
