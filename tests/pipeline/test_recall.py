"""Memorised maps of the stage `control`: how wrong they are, by hand; what is explored; flights before the runs."""

import numpy as np
import pytest
import torch

from affmap.config import sweep
from affmap.config.root import Config
from affmap.control.agent import Agent
from affmap.control.episodes import control
from affmap.env.layout import Layout
from affmap.model.lookup import make_lookup
from affmap.model.memory import MemorySettings
from affmap.model.windows import take_apart
from affmap.pipeline.recall import Survey, surveyed
from affmap.pipeline.train import untrained
from affmap.view import view

LINE = ["members=2", "data.num_sequences=3", "data.num_validation=1", "data.num_steps=30", "planner.num_iterations=1"]
LINE += ["model.context_size=3", "lookup.spacing=0.25", "control.num_steps=4", "control.runs_per_member=2"]


def prepared(memory: str, world: str, *more: str) -> tuple[Config, Survey, Layout]:
    """A survey of untrained members in a layout."""
    (config,) = sweep.jobs([*LINE, f"memory={memory}", f"control_layout={world}", *more])
    layout = config.control_layout
    assert isinstance(layout, Layout) and isinstance(config.memory, MemorySettings)
    stack = untrained(config)
    agent = Agent(stack, make_lookup(config.lookup, stack, [layout.map]), config.planner, config.control)
    return config, surveyed(config, agent, layout, config.memory), layout


def fly(config: Config, survey: Survey, layout: Layout) -> None:
    control(survey, [layout], config.vehicle, config.control, config.pilots)


def distance(survey: Survey, layout: Layout, before: Layout | None, radius: float) -> list[float]:
    """Error of the codes in memory as runs begin, one agent and one node at a time."""
    agent, found = survey.pilot.agent, []
    _, rows, columns, _ = survey.lookup.codes.shape
    for run, codes in enumerate(survey.lookup.codes):
        missed = whole = 0.0
        for i in range(rows):
            for j in range(columns):
                place = np.array([layout.size[0] * j / (columns - 1), layout.size[1] * i / (rows - 1)])
                seen = view(layout.map, place)
                if not layout.is_free(place, radius) or (before and (seen == view(before.map, place)).all()):
                    continue
                windows = take_apart(torch.from_numpy(seen)[None, None])
                true = agent.stack.encode(windows)[run // 2, 0]
                missed += float((codes[i, j] - true).square().sum())
                whole += float(true.square().sum())
        found.append((missed / whole) ** 0.5)
    return found


@pytest.mark.parametrize(("memory", "changed"), [("explored", False), ("outdated", True), ("empty", False)])
def test_errors_are_those_of_free_places_whose_view_has_changed(memory: str, changed: bool) -> None:
    """The error before the first step, where an obstacle has moved; of all free places, if none of them was seen."""
    config, survey, layout = prepared(memory, "one_moved")
    fly(config, survey, layout)
    recall = survey.recall(config.pilots)
    before = Layout.load("layout", "original") if changed else None
    expected = distance(survey, layout, before, config.vehicle.radius)
    np.testing.assert_allclose(recall.error[:, 0], expected, rtol=1e-4)
    assert recall.error.shape == (4, 5) and recall.earlier == 0 and list(recall.member) == [0, 0, 1, 1]
    assert (np.allclose(recall.error, recall.error[:, :1])) == (memory == "outdated")
    assert memory != "empty" or np.allclose(recall.error[:, 0], 1)


def test_the_memory_of_an_earlier_flight_is_kept() -> None:
    """Its steps come first in the errors; runs begin with what was learned in them; and their start is another."""
    config, survey, layout = prepared("repaired", "one_moved", "memory.early_steps=3")
    learned = survey.pilot.memory
    assert len(learned.weights) == 4
    fly(config, survey, layout)
    recall = survey.recall(config.pilots)
    assert recall.error.shape == (4, 1 + 3 + 4) and recall.earlier == 3
    assert torch.equal(survey.lookup.codes, survey.pilot.network.painted(learned, 0.25))
    assert not np.allclose(recall.at_first, recall.at_last)
    assert recall.best == np.argmin(recall.error[:2, -1])
    _, outdated, _ = prepared("outdated", "one_moved")
    fly(config, outdated, layout)
    np.testing.assert_allclose(recall.at_first, outdated.recall(config.pilots).at_first)


def test_it_explores_the_world_that_it_is_said_to() -> None:
    """A map of the original world, learned where it flies or from the layout of the data; another one elsewhere."""
    here, training, elsewhere = (
        prepared(memory, world)[1].pilot.memory.weights
        for memory, world in (("explored", "original"), ("outdated", "original"), ("explored", "one_moved"))
    )
    assert torch.equal(here, training) and not torch.allclose(here, elsewhere)
    assert torch.equal(training, prepared("outdated", "one_moved")[1].pilot.memory.weights)
