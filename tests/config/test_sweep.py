"""From command lines to jobs: in the experiment's order, the command line wins, and equal to Hydra's own expansion."""

import itertools
import re
from collections.abc import Sequence

import pytest

from affmap.cli.app import read_sweep
from affmap.config import sweep
from affmap.config.sweep import Sweep
from affmap.pipeline.stage import TRAIN
from affmap.planning.cem import CEMPlanner
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


MEANING = "brackets, quotes, commas and = have a meaning of their own; complete it, or put quotes around text"


@pytest.mark.parametrize(
    ("line", "message"),
    [
        (["contextsize=3"], "contextsize is not a known key; did you mean model.context_size?"),
        (["model.contextsize=3"], "model.contextsize is not a known key; did you mean model.context_size?"),
        (["planer.horizon=3"], "planer is not a known key; did you mean planner?"),
        (["planner.horizn=3"], "planner.horizn is not a known key; did you mean planner.horizon?"),
        (["experimnt=exp1"], "experimnt is not a known key; did you mean experiment?"),
        (["experiment=exp6_radii", "lerner=given"], "lerner is not a known key; did you mean learner?"),
        (["model/trnsition=gru"], "model/trnsition is not a known key; did you mean model/transition?"),
        (["hydra.launcher.njobs=2"], "hydra.launcher.njobs is not a known key; did you mean hydra.launcher.n_jobs?"),
        (["device=cuda"], "device is not a known key; did you mean control.device?"),
        (["n_jobs=2"], "n_jobs is not a known key; did you mean hydra.launcher.n_jobs?"),
        (["moon=full"], "moon is not a known key; correct its spelling."),
        (
            ["planner=cme"],
            "planner = 'cme' does not exist; did you mean cem? There are: cem, gradient, printed/cem, ",
        ),
        (
            ["experiment=factor/beta"],
            "experiment = 'factor/beta' does not exist; did you mean factors/beta? There are: ",
        ),
        (["planner={a: 1}"], "planner.a is not a known key; correct its spelling."),
        *(
            (
                [*line, f"planner.{key}=3"],
                f"planner.{key} is a key of planner={planner} only, and not every job here has that; say "
                f"planner={planner}, or leave the key out.",
            )
            for line, key, planner in [
                (["planner=gradient"], "num_elites", "cem"),
                (["experiment=exp1"], "num_elites", "cem"),  # it sweeps over both
                (["experiment=exp1"], "decay", "gradient"),
                ([], "decay", "gradient"),
            ]
        ),
        (
            ["agent=random", "agent.std=1"],
            "agent.std is a key of agent=filter and agent=oracle and agent=seen and agent=true_deviation and "
            "agent=true_mean only, ",
        ),
        (["+seed=3"], "seed is a key already; leave out the +."),
        (
            ["experiment=exp1", "JOBS=1"],
            "JOBS is a variable of make, as in make exp1 JOBS=...; affmap takes overrides such as scale=smoke, "
            "models=reference or hydra.launcher.n_jobs=1 instead.",
        ),
        (
            ["planner=oracle"],
            "planner = 'oracle' does not exist; there are: cem, gradient, printed/cem, printed/gradient.",
        ),
        *(
            ([f"{group}={name}"], f"{group} = {name!r} does not exist; did you mean {meant}? There are: ")
            for group, name, meant in [
                ("planner", "EB", "cem"),
                ("planner", "gb", "gradient"),
                ("model/transition", "GRU", "gru"),
            ]
        ),
        *(
            (
                [f"{key}=fog"],
                "layout is not a known key; choose a layout by world=doors, for all that names no other, or by "
                "training_layouts=[doors], control_layout=doors or map_layout=doors.",
            )
            for key in ("layout", "layout.name")
        ),
        (["lookup="], "lookup = '' does not exist; there are: exact, map."),
        (["hydra/launcher=nope"], "hydra/launcher = 'nope' does not exist; there are: basic, joblib, slurm."),
        *(
            ([line], f"the override {line!r} cannot be read: {remedy}.")
            for line, remedy in [
                ("model.context_size", "write key=value, such as model.context_size=3"),
                ("", "write key=value, such as model.context_size=3"),
                ("größe=3", "write key=value, such as model.context_size=3"),
                ("title=a\nb", "'\\n' does not print; leave it out"),
                ("output=~/x", "a shell knows ~ at the beginning of a word only; write $HOME instead"),
                ("output=a~b", "text with ~ needs quotes, as in 'output=\"a~b\"'"),
                ("++title=Müller & Co.", "text with ü needs quotes, as in '++title=\"Müller & Co.\"'"),
                ("output=[a;b]", "text with ; needs quotes"),
                ("title=C:\\é", "text with é needs quotes"),
                *(
                    (line, MEANING)
                    for line in (
                        "model.context_size=[1",
                        "title=a(b",
                        "title='é",
                        "title=a=b",
                        "seed=1,,2",
                        "title={a",
                    )
                ),
            ]
        ),
        (["seed=range()"], "the override 'seed=range()' cannot be read: evaluating 'range()': missing a required "),
        (["title=${nope}"], "this cannot be read: Interpolation key 'nope' not found."),
    ],
)
def test_errors_of_hydra_name_the_override_and_a_remedy(line: list[str], message: str) -> None:
    """By hand; nothing of Hydra's own grammar or places is in them."""
    with pytest.raises(ConfigError, match=f"^{re.escape(message)}"):
        sweep.jobs(sweep.complete(line))


def test_the_options_of_a_group_include_files_in_folders() -> None:
    with pytest.raises(ConfigError, match=r"^experiment = 'moon' does not exist; there are: exp1, .*, factors/beta, "):
        sweep.complete(["experiment=moon"])


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("model.context_size=1,1", "model.context_size=1,1 gives 1 twice; give each value once."),
        ("planner=choice(cem,gradient,cem)", "planner=choice(cem,gradient,cem) gives cem twice; give each value once."),
        ("title='a b','a b'", "title='a b','a b' gives 'a b' twice; give each value once."),
        (
            "model.context_size=1,1.0",
            "model.context_size=1 and model.context_size=1.0 have the same results; leave one of",
        ),
        ("output=a,b", "output=a and output=b have the same results; leave one of them out: output=a."),
        (
            "seed=0,5",
            "member 5 would be in two jobs (seed=0 members=25 and seed=5 members=25); give each member to one, ",
        ),
    ],
)
def test_jobs_that_are_the_same_are_told_by_what_makes_them_so(line: str, message: str) -> None:
    """A value that is given twice, values that mean the same, keys that results do not depend on, members."""
    with pytest.raises(ConfigError, match=f"^{re.escape(message)}"):
        read_sweep([line])


def test_of_swept_files_that_say_the_same_one_is_to_be_left_out() -> None:
    """One of Experiment VII's files sets the guide only, which the command line sets for all; the remedy works."""
    line = ["experiment=exp7_doors", "control.guide=time_to_go"]
    remedy = "lookahead=horizon_20,horizon_80"
    with pytest.raises(ConfigError, match=f"have the same results; leave one of them out: {remedy}.$"):
        read_sweep(line)
    assert len(read_sweep([*line, remedy]).configs) == 2


@pytest.mark.parametrize(
    ("line", "remedy"),
    [
        (["learner=given"], "world=four_properties"),  # it names the layouts of training only
        (["learner=given", "world=four_properties", "control_layout=fog"], "control_layout=four_properties"),
        (["control_layout=spiral"], "control_layout=original"),
    ],
)
def test_of_other_channels_than_the_models_a_layout_is_named_that_has_theirs(line: list[str], remedy: str) -> None:
    """As the paper's worlds have: one with the four properties, or obstacles alone; with it, there are jobs."""
    with pytest.raises(ConfigError, match=f"a model sees the same ones everywhere, so say {remedy}.$"):
        Sweep.read(line)
    key = remedy.partition("=")[0]
    rest = [each for each in line if each.partition("=")[0] != key]
    assert Sweep.read([*rest, remedy]).configs


@pytest.mark.parametrize("key", ["world", "control_layout", "map_layout", "training_layouts"])
def test_a_layout_that_does_not_exist_is_reported(key: str) -> None:
    """Its name, and those that there are."""
    with pytest.raises(ConfigError, match=r"conf/layout/moon.yaml does not exist; conf/layout holds: .*original"):
        sweep.jobs([f"{key}=[moon]" if key == "training_layouts" else f"{key}=moon"])


def test_a_layout_that_is_misspelt_is_suggested() -> None:
    with pytest.raises(
        ConfigError,
        match=r"^[\w/. ]+: training_layouts\[0\], control_layout, map_layout = 'orignal': conf/layout/orignal\.yaml "
        r"does not exist; did you mean original\? There are: [\w, ]+\.$",
    ):
        sweep.jobs(["world=orignal"])


def flown(line: Sequence[str]) -> list[tuple[str, str, int, int]]:
    """Agent, layout, first seed and number of members of each job of the baselines of a command line."""
    baselines = Sweep.read(line).baselines()
    assert baselines is not None
    return [(job.controller, job.control_layout.name, job.seed, job.members) for job in baselines.configs]


AGENTS = ("oracle", "straight", "random")


@pytest.mark.parametrize(
    ("line", "places"),
    [
        (["experiment=exp1"], ["original"]),
        (["experiment=exp2"], ["original", "two_obstacles", "twelve_obstacles"]),
        (["experiment=exp3"], ["original", "three_looks"]),
        (["experiment=exp4"], ["fog"]),
        (["experiment=exp5"], ["procedural_easy", "procedural_hard"]),
        (["experiment=exp5", "control_layout=procedural_hard"], ["procedural_hard"]),
    ],
)
def test_baselines_fly_in_every_layout_of_their_experiment(line: list[str], places: list[str]) -> None:
    """By hand: three agents in each layout, all members at once, with the model of the first context size."""
    assert flown(line) == [(agent, place, 0, 25) for agent in AGENTS for place in places]
    sweep, baselines = Sweep.read(line), Sweep.read(line).baselines()
    assert baselines is not None
    assert {job.model.context_size for job in baselines.configs} == {0} == {sweep.first.model.context_size}
    assert {job.planner for job in baselines.configs} == {sweep.first.planner}
    trained = {TRAIN.of(job).digest for job in sweep.configs}
    assert {TRAIN.of(job).digest for job in baselines.configs} <= trained, "they need no training of their own"
    for job in baselines.configs:
        assert job.output == sweep.first.output / "baselines"
        assert (job.growth, job.baselines, job.store) == (None, (), sweep.first.store)
    assert baselines.companions() == []


@pytest.mark.parametrize(
    "more",
    [
        ["planner=gradient"],
        ["planner=gradient,cem"],
        ["planner=gradient", "planner.decay=0.9", "++planner.learning_rate=0.1"],
        ["planner=gradient", "planner.decay=0.9,0.99"],
    ],
)
def test_baselines_of_a_planner_that_follows_gradients_plan_with_the_other(more: list[str]) -> None:
    """As `conf/planner/cem.yaml` says: the true physics has no gradients; the gradient's keys are gone."""
    line = ["experiment=exp1", *more]
    assert Sweep.read(line).first.planner.kind == "gradient"
    baselines = Sweep.read(line).baselines()
    assert baselines is not None
    assert [job.planner for job in baselines.configs] == [CEMPlanner.load("planner", "cem")] * 3


def test_baselines_take_the_first_value_of_what_has_nothing_to_do_with_them() -> None:
    """By hand: of planner, context size, horizon and spacing; what the line says once stays, as all of its scale."""
    line = ["experiment=exp1", "planner=cem,gradient", "planner.horizon=5,10", "lookup.spacing=0.1,0.02"]
    baselines = Sweep.read([*line, "model.context_size=3,8", "control.beta=2", "scale=smoke"]).baselines()
    assert baselines is not None and len(baselines.configs) == 3
    for job in baselines.configs:
        assert job.planner == CEMPlanner.load("planner", "cem", horizon=5, num_iterations=3)
        assert (job.lookup.name, job.model.context_size, job.control.beta) == ("map of 0.1 u", 3, 2.0)
        assert job.members == 2 and job.notice is not None


def test_baselines_are_divided_as_the_members_are() -> None:
    """By hand: members of 0 to 9 in two jobs, for each agent; a folder given for the output is that of both reports."""
    line = ["experiment=exp1", "seed=0,5", "members=5", "output=here"]
    assert flown(line) == [(agent, "original", seed, 5) for seed in (0, 5) for agent in AGENTS]
    baselines = Sweep.read(line).baselines()
    assert baselines is not None and {str(job.output) for job in baselines.configs} == {"here/baselines"}
    assert flown(["experiment=exp1", "members=2,3", "seed=1"]) == [
        (agent, "original", 1, members) for members in (2, 3) for agent in AGENTS
    ]


def test_baselines_are_those_that_are_named() -> None:
    """By hand; agents of the experiment itself do not count, and without any, or in a comparison, there are none."""
    assert flown(["experiment=exp1", "baselines=[straight]"]) == [("straight", "original", 0, 25)]
    assert flown(["baselines=[random,oracle]", "agent=straight"]) == [
        ("random", "original", 0, 25),
        ("oracle", "original", 0, 25),
    ]
    assert flown(["experiment=exp1", "agent=planner,random"]) == [(agent, "original", 0, 25) for agent in AGENTS]
    for line in ([], ["experiment=exp1", "baselines=[]"], ["experiment=exp1", "report.compare=planner"]):
        assert Sweep.read(line).baselines() is None and Sweep.read(line).companions() == []
    with pytest.raises(ConfigError, match=r"^agent = 'moon' does not exist; there are: filter, oracle, "):
        Sweep.read(["experiment=exp1", "baselines=[moon]"]).baselines()


def test_the_longer_training_and_the_baselines_belong_to_experiment_3() -> None:
    """Both, in this order; the longer training has no baselines."""
    growth, baselines = Sweep.read(["experiment=exp3"]).companions()
    assert growth.first.name == "exp3_growth" and growth.companions() == []
    assert [job.controller for job in baselines.configs] == [agent for agent in AGENTS for _ in range(2)]


def test_a_bad_value_in_one_job_of_a_sweep_is_reported_before_any_starts() -> None:
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
