"""The tasks of the stage `control`: one for all runs, or one for each, the same for all agents."""

import pytest

from affmap.config import sweep
from affmap.control.variation import Task
from affmap.pipeline import control

LINE = ["members=3", "control.runs_per_member=2"]


@pytest.mark.parametrize(
    ("more", "number"),
    [([], 1), (["variation=mass/0.2"], 1), (["variation=size/2"], 1), (["variation=place/0.1"], 6)],
)
def test_there_is_one_task_unless_worlds_are_drawn(more: list[str], number: int) -> None:
    """By hand. Tasks differ in their layouts only, and these depend on member and run only."""
    every = [control._tasks(config) for config in sweep.jobs([*LINE, *more, "model.context_size=0,8"])]
    assert every[0] == every[1] and len({task.layout for task in every[0]}) == len(every[0]) == number
    assert len({(task.vehicle, task.settings) for task in every[0]}) == 1
    if number > 1:
        (alone,) = sweep.jobs(["members=1", "seed=2", "control.runs_per_member=2", *more])
        assert [task.layout for task in control._tasks(alone)] == [task.layout for task in every[0][4:]]


def test_home_is_no_variation() -> None:
    """The same digests, so that the stage is shared; and the tasks are those of the configuration."""
    plain, home = (sweep.jobs([*LINE, *more])[0] for more in ([], ["variation=home"]))
    assert plain == home
    assert control._tasks(home) == [Task(home.control_layout, home.vehicle, home.control)]  # type: ignore[arg-type]


def test_worlds_that_are_drawn_can_be_varied() -> None:
    """A random world of Experiment V with another mass, and one whose arena is larger."""
    world = ["world=four_properties", "control_layout=procedural_easy"]
    plain, heavy, large = (
        control._tasks(sweep.jobs([*LINE, *world, f"variation={text}"])[0]) for text in ("home", "mass/0.2", "size/2")
    )
    assert len(plain) == len(heavy) == len(large) == 6
    assert [task.layout for task in plain] == [task.layout for task in heavy]
    assert {task.vehicle.mass for task in heavy} == {0.2}
    assert [len(task.layout.circles) for task in plain] == [len(task.layout.circles) for task in large]
