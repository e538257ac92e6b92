"""Agents trained by one call: against a sweep with the same settings, its files and its recorded flights."""

import shutil
import tempfile
from collections.abc import Callable
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import torch
from commands import jobs

import affmap
from affmap import pipeline
from affmap.config.root import Config
from affmap.control.agent import Agent
from affmap.data.collect import DATASET, read_dataset
from affmap.env.procedural import Procedural
from affmap.pipeline import agents, datasets, execution
from affmap.pipeline.stage import DATA, TRAIN
from affmap.random import generator
from affmap.results.setting import Setting
from affmap.settings import ConfigError
from affmap.store.stage import StoreError

SETTINGS: dict[str, Any] = {
    "context_size": 1,
    "members": 2,
    "epochs": 2,
    "data": {"num_sequences": 4, "num_validation": 1, "num_steps": 20},
    "planner": {"num_iterations": 3},
    "lookup": {"spacing": 0.25},
    "control": {"num_steps": 3},
    "progress": False,
}
"""The same as `commands.TINY` in one call."""


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Setting]:
    """A job of a sweep: its folder, and its stages."""
    folder = tmp_path_factory.mktemp("swept")
    (config,) = jobs(folder, "model.context_size=1")
    return folder, pipeline.run(config)


def files(store: Path) -> dict[str, bytes]:
    """All results of exploration and training, but for the circumstances."""
    paths = [path for stage in ("data", "train") for path in sorted((store / stage).rglob("*")) if path.is_file()]
    return {str(path.relative_to(store)): path.read_bytes() for path in paths if path.name != "provenance.json"}


def weights(agent: Agent) -> dict[str, torch.Tensor]:
    return agent.stack.state_dict()


def same(one: Agent, other: Agent) -> bool:
    return all(torch.equal(weight, weights(other)[name]) for name, weight in weights(one).items())


def test_a_call_writes_what_a_sweep_writes(swept: tuple[Path, Setting], tmp_path: Path) -> None:
    """Names and bytes of all files; so members are those of the sweep."""
    affmap.train("original", **SETTINGS, folder=tmp_path / "mine")
    assert files(tmp_path / "mine") == files(swept[0] / "store")
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]


def test_the_agent_flies_what_the_sweep_has_recorded(swept: tuple[Path, Setting]) -> None:
    """Bit for bit, from the sweep's own folder, in which nothing is made anew."""
    folder, setting = swept
    before = {path: path.stat().st_mtime_ns for path in folder.rglob("*")}
    agent = affmap.train("original", **SETTINGS, folder=folder / "store")
    assert {path: path.stat().st_mtime_ns for path in folder.rglob("*")} == before
    recorded, flown = np.load(setting.control[0] / "trajectories.npz"), affmap.fly(agent, "original").trajectories
    for key in ("position", "goal", "action", "planned_position", "planned_std"):
        np.testing.assert_array_equal(flown[key], recorded[key], err_msg=key)
    assert agent.vehicle == affmap.Vehicle.load("vehicle", "default") and agent.channels == ("solid",)


def test_without_a_folder_only_the_agent_remains(
    swept: tuple[Path, Setting], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    agent = affmap.train("original", **SETTINGS)
    assert same(agent, affmap.train("original", **SETTINGS, folder=swept[0] / "store"))
    assert not list(tmp_path.iterdir())


def test_an_interrupted_call_is_resumed_by_the_same(
    swept: tuple[Path, Setting], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ctrl-C after the first epoch: neither exploration nor that epoch is repeated, and the files are the same."""
    shown: list[tuple[str, int]] = []

    def display(last: int) -> Callable[..., AbstractContextManager[Callable[..., None]]]:
        @contextmanager
        def show(description: str, total: int, unit: str) -> Any:
            def update(finished: int, remark: str = "") -> None:
                shown.append((unit, finished))
                if unit == "epochs" and finished == last:
                    raise KeyboardInterrupt

            yield update

        return show

    monkeypatch.setattr(agents, "silent", display(1))
    with pytest.raises(KeyboardInterrupt) as stopped:
        affmap.train("original", **SETTINGS, folder=tmp_path)
    (note,) = stopped.value.__notes__
    assert note == f"affmap.train was interrupted; {tmp_path} keeps its work: the same call resumes."
    assert shown == [*(("sequences", number) for number in (1, 2, 3, 4)), ("epochs", 1)]
    shown.clear()
    monkeypatch.setattr(agents, "silent", display(-1))
    affmap.train("original", **SETTINGS, folder=tmp_path)
    assert shown == [("epochs", 2)]
    assert files(tmp_path) == files(swept[0] / "store")


def test_another_training_on_the_same_data_set(swept: tuple[Path, Setting], tmp_path: Path) -> None:
    """From the sweep's folder, wherever it lies: with the same settings the same weights; no data are written."""
    folder, setting = swept
    dataset = shutil.copytree(setting.data[0], tmp_path / "copied")
    rest = {key: value for key, value in SETTINGS.items() if key != "data"}
    agent = affmap.train(dataset=dataset, **rest, folder=tmp_path / "store")
    assert same(agent, affmap.train("original", **SETTINGS, folder=folder / "store"))
    assert [path.name for path in (tmp_path / "store").iterdir()] == ["train"]
    with pytest.raises(ConfigError, match=r"^dataset has layouts, data of its own; leave layouts, data out\.$"):
        affmap.train("original", dataset=dataset, **SETTINGS)
    (dataset / "dataset.npz").write_bytes(b"")
    with pytest.raises(StoreError, match="corrupted"):
        affmap.train(dataset=dataset, **rest)


def test_arrays_of_one_s_own_are_trained_on(swept: tuple[Path, Setting], tmp_path: Path) -> None:
    """The arrays of the sweep's data set, without those that training does not read: the same weights, by a stage of
    another name; other arrays make another."""
    arrays = read_dataset(swept[1].data[0] / DATASET)
    own = {key: arrays[key].tolist() for key in ("position", "view", "action")}
    options = {**SETTINGS, "data": {"num_validation": 1}, "folder": tmp_path}
    agent = affmap.train("original", dataset=own, **options)
    assert same(agent, affmap.train("original", **SETTINGS, folder=swept[0] / "store"))
    assert [path.name for path in tmp_path.iterdir()] == ["train"]
    (folder,) = (tmp_path / "train").iterdir()
    assert folder.name != swept[1].train[0].name
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")}
    affmap.train("original", dataset=own, **options)
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")} == before
    other = affmap.train("original", dataset={**own, "action": 1 - arrays["action"]}, **options)
    assert not same(agent, other) and len(list((tmp_path / "train").iterdir())) == 2


ARRAYS = {"position": np.zeros((4, 6, 2)), "view": np.zeros((4, 5, 1, 11, 11)), "action": np.zeros((4, 5, 4))}


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (
            {"action": None},
            r"^dataset has no action; give position, view, action, .* affmap\.data\.collect\.collect\.$",
        ),
        ({"position": np.zeros((4, 5, 2))}, r"position has the shape \[4, 5, 2\]; it should be \[4, 6, 2\]\.$"),
        ({"view": np.zeros((4, 5, 2, 11, 11))}, r"view has the shape .* it should be \[4, 5, 1, 11, 11\]\.$"),
        ({"action": 0}, r"action has the shape \[\]|position has the shape"),
        ({"action": [[1], [1, 2]]}, r"^dataset holds no numbers"),
        ({"action": np.full((4, 5, 4), 2.0)}, r"^dataset: positions should be finite, and actions in \[0, 1\]\.$"),
        ({"position": np.full((4, 6, 2), np.nan)}, r"^dataset: positions should be finite"),
        ({"view": np.full((4, 5, 1, 11, 11), 0.5)}, r"^dataset: views should be true or false, or 1 or 0\.$"),
        ({"view": np.full((4, 5, 1, 11, 11), np.nan)}, r"^dataset: views should be true or false"),
        (
            {"position": np.concatenate([np.zeros((2, 6, 2)), np.full((2, 6, 2), 2.5)])},
            r"^dataset: position \[2\.5, 2\.5\] is outside the arena \[3\.0, 2\.0\] \(u\) of 'two_obstacles'; give",
        ),
        (
            {key: array[:3] for key, array in ARRAYS.items()},
            r"3 sequences of 5 steps in 2 layouts; give each .* as many",
        ),
    ],
)
def test_arrays_that_are_no_data_set_are_told(change: dict[str, Any], told: str) -> None:
    given = {key: array for key, array in {**ARRAYS, **change}.items() if array is not None}
    with pytest.raises(ConfigError, match=told):
        affmap.train(["original", "two_obstacles"], dataset=given)
    with pytest.raises(ConfigError, match=r"num_validation = 40 leaves nothing to train on"):
        affmap.train(["original", "two_obstacles"], dataset=ARRAYS)


def test_what_is_no_data_set_or_lacks_its_layouts_is_told() -> None:
    """Positions that are reported from inside fog may lie outside the arena."""
    with pytest.raises(
        ConfigError, match=r"^dataset = 3 is not allowed; give arrays, .* or the folder of a data set\.$"
    ):
        affmap.train("original", dataset=3)  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match=r"^dataset has arrays, which do not say where .*; give layouts, too, as in"):
        affmap.train(dataset=ARRAYS)
    fog = affmap.Layout.load("layout", "fog")
    noisy = {**ARRAYS, "view": np.zeros((4, 5, len(fog.channels), 11, 11)), "position": np.full((4, 6, 2), -0.1)}
    assert (datasets.own(noisy, [fog])["position"] < 0).all()
    with pytest.raises(ConfigError, match=r"^dataset: position \[-0\.1.* is outside the arena"):
        datasets.own({**noisy, "view": ARRAYS["view"]}, [affmap.Layout.load("layout", "original")])


class AskedError(Exception):
    """Carries the configuration of a call that trains nothing."""


@pytest.fixture
def configured(monkeypatch: pytest.MonkeyPatch) -> Callable[..., Config]:
    """The configuration that a call would train."""

    def ask(config: Config, *_: Any) -> None:
        raise AskedError(config)

    monkeypatch.setattr(agents, "models", ask)

    def configure(*arguments: Any, **options: Any) -> Config:
        with pytest.raises(AskedError) as asked:
            affmap.train(*arguments, **options)
        config: Config = asked.value.args[0]
        return config

    return configure


@pytest.mark.parametrize(
    ("layouts", "options", "overrides"),
    [
        ("original", {}, ["scale=full"]),
        ("fog", {"context_size": 3, "members": 7, "epochs": 4, "seed": 2}, ["world=fog", "model.context_size=3"]),
        ("original", {"transition": "gru"}, ["model/transition=gru"]),
        ("original", {"transition": {"kind": "gru"}, "model": {"hidden_size": 9}}, ["model.hidden_size=9"]),
        (
            ["two_obstacles", affmap.Layout.load("layout", "original")],
            {},
            ["training_layouts=[two_obstacles,original]"],
        ),
        (affmap.Layout.load("layout", "original").plain, {"vehicle": {"thrust": 0.5}}, ["vehicle.thrust=0.5"]),
        ("original", {"training": {"batch_size": 5, "vision_lr": 0.1}}, ["training.vision_lr=0.1"]),
        ("original", {"data": {"seed": 3}, "control": {"beta": 2}}, ["data.seed=3"]),
    ],
)
def test_stages_are_those_of_the_command(
    configured: Callable[..., Config], tmp_path: Path, layouts: Any, options: dict[str, Any], overrides: list[str]
) -> None:
    """Digests of exploration and training; the command's line says the same."""
    more = {"members": "members", "epochs": "training.num_epochs", "seed": "seed"}
    line = [f"{more[key]}={value}" for key, value in options.items() if key in more]
    line += ["model/transition=gru"] if "transition" in options and "model" in options else []
    line += ["training.batch_size=5"] if "training" in options else []
    (expected,) = affmap.config.sweep.jobs(["output=out", "store=store", "reference=reference", *overrides, *line])
    config = configured(layouts, **options)
    assert [stage.of(config).digest for stage in (DATA, TRAIN)] == [
        stage.of(expected).digest for stage in (DATA, TRAIN)
    ]


def test_groups_may_be_named_or_given_as_settings(configured: Callable[..., Config]) -> None:
    """A planner of another kind has none of the first one's keys; devices are no part of a digest, but count."""
    planner = affmap.GradientPlanner.load("planner", "gradient", horizon=7)
    control = affmap.control.ControlSettings.load("control", "default", beta=3.0, device="cuda")
    config = configured("original", planner=planner, control=control, lookup="exact", model="default", transition="gru")
    assert config.model.transition.kind == "gru"
    assert (config.planner, config.control, config.lookup.spacing) == (planner, control, 0)
    assert configured("original", planner="gradient").planner.kind == "gradient"
    assert configured("original", planner={**planner.plain}).planner == planner


def test_a_planner_of_another_kind_may_be_given_in_part(configured: Callable[..., Config]) -> None:
    """Its missing keys are those of the file with its name, as in a call of its class."""
    config = configured("original", planner={"kind": "gradient", "horizon": 7})
    assert config.planner == affmap.GradientPlanner(horizon=7)


def test_a_key_may_be_given_twice_with_one_value(configured: Callable[..., Config]) -> None:
    """By an argument and in its group."""
    gru = {"transition": {"kind": "gru"}, "context_size": 3}
    config = configured("original", model=gru, context_size=3, transition="gru", epochs=2, training={"num_epochs": 2})
    assert (config.model.transition.kind, config.model.context_size, config.training.num_epochs) == ("gru", 3, 2)
    settings = affmap.ModelSettings(**gru)
    assert configured("original", model=settings, context_size=3, transition={"kind": "gru"}).model == settings


def test_of_rules_there_are_worlds_of_their_own(configured: Callable[..., Config]) -> None:
    """As many as asked for, all different; none is the first that a member flies in."""
    rules = Procedural.load("layout", "procedural_easy")
    config = configured(["four_properties", "procedural_easy"], worlds=3, data={"seed": 4})
    expected = [rules.draw(generator(4, "training world", world)) for world in range(3)]
    assert config.training_layouts == (affmap.Layout.load("layout", "four_properties"), *expected)
    flown = [rules.draw(generator(member, "world", run)) for member in range(3) for run in range(3)]
    assert not any(layout in flown for layout in expected)


@pytest.mark.usefixtures("configured")
@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"members": 0}, r"^train: members = 0 is not allowed"),
        ({"context_size": -1}, r"^train: model\.context_size = -1 is not allowed"),
        ({"epochs": 0}, r"^train: training\.num_epochs = 0 is not allowed"),
        ({"training": {"epoch": 3}}, r"^train: training\.epoch = 3 is not a known key"),
        ({"training": {"vision_lr": [1, 2]}}, r"makes a training of 2 trials"),
        ({"data": 5}, r"^data = 5 is not allowed: give some of its keys and values, such as \{'seed': 0\}"),
        ({"data": {"num_sequences": 0}}, r"num_sequences = 0 is not allowed"),
        ({"planner": "pid"}, r"conf/planner holds: cem, gradient"),
        (
            {"transition": "lstm"},
            r"conf/model/transition holds: additive, gatel0rd, gru, hyper, mlp, split, split_channels",
        ),
        (
            {"context_size": 8, "model": {"context_size": 3}},
            r"^model has context_size = 3, and context_size gives 8; give it once\.$",
        ),
        (
            {"epochs": 2, "training": affmap.TrainingSettings(num_epochs=3)},
            r"^training has num_epochs = 3, and epochs gives 2; give it once\.$",
        ),
        (
            {"transition": "gru", "model": {"transition": {"kind": "mlp"}}},
            r"^model has transition = \{'kind': 'mlp'\}, and transition gives \{'kind': 'gru', .*\}; give it once\.$",
        ),
        (
            {"dataset": ARRAYS, "data": {"num_sequences": 3}},
            r"^data has num_sequences = 3, and dataset gives 4; give it once\.$",
        ),
        ({"layouts": []}, r"^train needs layouts to explore, as in affmap\.train\('original'\), or a dataset\.$"),
        ({"layouts": None}, r"^train needs layouts to explore"),
        ({"layouts": 3}, r"^layout = 3 is not allowed"),
        ({"layouts": "mars"}, r"conf/layout/mars\.yaml does not exist"),
        ({"layouts": ["original", "fog"]}, r"'fog' has channels"),
        ({"worlds": 0}, r"^worlds = 0 is not allowed; give a whole number, 1 or more\.$"),
        ({"folder": "~/x"}, r"^folder = '~/x' is not allowed: it should not begin with ~"),
        ({"folder": 3}, r"^folder = 3 is not allowed; give a path, such as 'runs/mine'\.$"),
        ({"folder": __file__}, r"^folder = '.*test_agents\.py' is a file; give another folder\.$"),
        ({"folder": agents.reference() / "store"}, r"is of the reference run; give a folder of your own\.$"),
        ({"dataset": "mars"}, r"^dataset = 'mars' does not exist; give the folder data/<digest> of a store"),
        ({"dataset": __file__}, r"^dataset = '.*test_agents\.py' is no data set; give the folder data/<digest>"),
        ({"members": 10**6, "model": {"hidden_size": 10**6}}, r"^train: members = 1000000, .* GiB of memory"),
    ],
)
def test_a_mistake_is_told(options: dict[str, Any], told: str) -> None:
    """Before anything is made."""
    with pytest.raises(ConfigError, match=told):
        affmap.train(**{"layouts": "original", **options})


def test_a_folder_with_something_else_stays_as_it_is(swept: tuple[Path, Setting], tmp_path: Path) -> None:
    """A saved agent; this repository's `conf`. What file managers leave is nothing else."""
    affmap.train("original", **SETTINGS, folder=swept[0] / "store").save(tmp_path / "mine")
    before = [*tmp_path.rglob("*")]
    for folder, name in ((tmp_path / "mine", r"agent\.json"), (Path(__file__).parents[2] / "conf", r"agent")):
        with pytest.raises(ConfigError, match=rf"^folder = '.*' has {name}, .* give a folder of their own, which may"):
            affmap.train("original", **SETTINGS, folder=folder)
    assert [*tmp_path.rglob("*")] == before
    (tmp_path / "new").mkdir()
    (tmp_path / "new/.DS_Store").touch()
    affmap.train("original", **SETTINGS, folder=tmp_path / "new")


def test_the_loss_is_shown(swept: tuple[Path, Setting], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Lines of both stages; the losses are those of the table."""
    options = {key: value for key, value in SETTINGS.items() if key != "progress"}
    affmap.train("original", **options)
    table = execution.files.read_validation(swept[1].train[0])
    losses = table.groupby("epoch")["validation_nll"].median()
    description = "training of 2 members, context size 1"
    assert capsys.readouterr().err.splitlines() == [
        *(f"exploration of original: {number} of 4 sequences" for number in (1, 2, 3, 4)),
        *(f"{description}: {epoch} of 2 epochs, validation {loss:.2f} nats" for epoch, loss in losses.items()),
    ]


def test_the_agent_knows_the_losses_of_its_training(swept: tuple[Path, Setting], tmp_path: Path) -> None:
    """Those of the sweep's table, also after it was saved; of the members that are loaded, and in another world."""
    table = execution.files.read_validation(swept[1].train[0])
    agent = affmap.train("original", **SETTINGS, folder=swept[0] / "store")
    agent.save(tmp_path / "mine")
    for each in (agent, affmap.load(tmp_path / "mine"), agent.elsewhere(agent.lookup.worlds)):
        pd.testing.assert_frame_equal(each.losses, table, check_exact=True)
    (alone,) = affmap.load(tmp_path / "mine", members=[1]).losses["member"].unique()
    assert list(table.columns) == ["member", "epoch", "training_nll", "validation_nll"] and alone == 1


def test_a_training_has_the_threads_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """As counted where it begins; the caller's number is put back."""
    before = torch.get_num_threads()

    def count(*_: Any) -> None:
        raise AskedError(torch.get_num_threads())

    monkeypatch.setattr(agents, "models", count)
    for threads in (1, 2):
        with pytest.raises(AskedError, match=f"^{threads}$"):
            affmap.train("original", threads=threads)
        assert torch.get_num_threads() == before
