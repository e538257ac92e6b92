"""From command lines to jobs: in the experiment's order, the command line wins, and equal to Hydra's own expansion."""

import itertools
from collections.abc import Sequence

import pytest

from affmap.config import sweep
from affmap.settings import ConfigError

EXP1 = ["planner=cem,gradient", "model.context_size=0,1,3,5,8"]


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ([], []),
        (["model.context_size=5"], ["model.context_size=5"]),
        (["model.context_size=5,8"], ["model.context_size=5,8"]),
        (["experiment=exp1"], ["experiment=exp1", *EXP1]),
        (["experiment=exp1", "scale=smoke", "seed=3"], ["experiment=exp1", "scale=smoke", "seed=3", *EXP1]),
        (["planner=gradient", "experiment=exp1"], ["experiment=exp1", "planner=gradient", EXP1[1]]),
        (
            ["model.context_size=2", "planner=cem", "experiment=exp1"],
            ["experiment=exp1", "planner=cem", "model.context_size=2"],
        ),
        (["experiment=exp1", "model.context_size=8,0"], ["experiment=exp1", EXP1[0], "model.context_size=8,0"]),
        (["experiment=exp1", "members=2,3"], ["experiment=exp1", "members=2,3", *EXP1]),
        (["experiment=exp1", "++model.context_size=2"], ["experiment=exp1", EXP1[0], "++model.context_size=2"]),
        (["experiment=exp1", "sweep.planner=cem"], ["experiment=exp1", "sweep.planner=cem", "planner=cem", EXP1[1]]),
    ],
)
def test_a_command_line_is_completed_by_the_experiment_s_sweep(line: list[str], expected: list[str]) -> None:
    """Written out by hand: what the command line sets is not swept over, at the place the experiment gives it."""
    assert sweep.complete(line) == expected
    assert sweep.complete(sweep.complete(line)) == expected  # completing again changes nothing


def settings(line: Sequence[str]) -> list[tuple[str, int]]:
    return [(job.planner.kind, job.model.context_size) for job in sweep.jobs(line)]


def test_experiment_1_is_ten_jobs() -> None:
    """Section 5.3: five context sizes and two planners; the last key varies fastest, at the paper's scale."""
    jobs = sweep.jobs(sweep.complete(["experiment=exp1"]))
    expected = list(itertools.product(("cem", "gradient"), (0, 1, 3, 5, 8)))
    assert [(job.planner.kind, job.model.context_size) for job in jobs] == expected
    for job in jobs:
        assert job.members * job.control.runs_per_member == 100 and job.control.num_steps == 200
        assert (job.data.num_sequences, job.data.num_steps, job.data.num_validation) == (200, 300, 40)
        assert (job.training.num_epochs, job.training.batch_size, job.planner.horizon) == (50, 10, 20)


def test_jobs_are_what_hydra_makes_of_the_line() -> None:
    """Ranges and choices that Hydra's grammar knows, expanded by hand."""
    assert settings(["model.context_size=range(0,3)", "planner=cem,gradient"]) == [
        (planner, size) for size, planner in itertools.product((0, 1, 2), ("cem", "gradient"))
    ]
    assert settings(["model.context_size=choice(8,1)"]) == [("cem", 8), ("cem", 1)]
    assert settings(["model.context_size=3"]) == [("cem", 3)]
    assert settings([]) == [("cem", 8)]
    assert [list(job.seeds) for job in sweep.jobs(["seed=range(2)", "members=1"])] == [[0], [1]]


@pytest.mark.parametrize("line", [["experiment=exp1,exp1"], ["experiment=glob(*)"], ["experiment=a,b", "seed=1"]])
def test_several_experiments_at_once_are_refused(line: list[str]) -> None:
    with pytest.raises(ConfigError, match="experiment takes one name at a time"):
        sweep.complete(line)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        (["contextsize=3"], "Could not override 'contextsize'"),
        (["model.contextsize=3"], "Could not override 'model.contextsize'"),
        (["planner=oracle"], "Could not find 'planner/oracle'.*cem.*gradient"),
        (["experiment=exp99"], "Could not find 'experiment/exp99'.*exp1.*factors/beta"),
        (["model.context_size"], "model.context_size"),
        (["model.context_size=[1"], "no viable alternative at input .\\[1"),
        (["planner=gradient", "planner.num_elites=3"], "planner.num_elites"),
    ],
)
def test_a_line_that_hydra_does_not_understand_is_told(line: list[str], message: str) -> None:
    """The part that is wrong, and the options there are."""
    with pytest.raises(ConfigError, match=f"^this cannot be read: .*{message}"):
        sweep.jobs(sweep.complete(line))


@pytest.mark.parametrize("key", ["world", "control_layout", "map_layout", "training_layouts"])
def test_a_layout_that_does_not_exist_is_told(key: str) -> None:
    """Its name, and those that there are."""
    with pytest.raises(ConfigError, match=r"conf/layout/moon.yaml does not exist; conf/layout holds: .*original"):
        sweep.jobs([f"{key}=[moon]" if key == "training_layouts" else f"{key}=moon"])


def test_another_experiment_with_the_same_command_line() -> None:
    """By hand: what is dropped, what is replaced, and what stays."""
    line = sweep.complete(["experiment=exp3", "scale=smoke", "++seed=3", "model.context_size=0,8"])
    swept = ("planner", "world", "model.context_size")
    assert sweep.instead(line, "exp3_growth", swept) == ["scale=smoke", "++seed=3", "experiment=exp3_growth"]
    assert sweep.instead(["output=a"], "exp1", ("output",)) == ["experiment=exp1"]


def test_a_bad_value_in_one_job_of_a_sweep_is_told_before_any_starts() -> None:
    """The third of three."""
    with pytest.raises(ConfigError, match=r"conf/model/default.yaml or the command line: model.context_size = -2 "):
        sweep.jobs(sweep.complete(["experiment=exp1", "model.context_size=0,1,-2"]))


def test_nothing_is_left_behind_in_hydra() -> None:
    """Composing does not keep Hydra's global state: a second composition of another kind works the same."""
    from hydra.core.global_hydra import GlobalHydra

    before = settings(["planner=gradient"])
    assert not GlobalHydra.instance().is_initialized()
    with pytest.raises(ConfigError):
        sweep.jobs(["members=0"])
    assert not GlobalHydra.instance().is_initialized()
    assert settings(["planner=gradient"]) == before
