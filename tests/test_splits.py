"""One experiment, any split: members in one stack, in jobs of their own, or in between give the same tables."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from commands import in_process, jobs, line

from affmap import pipeline
from affmap.cli.app import read_sweep
from affmap.config.sweep import Sweep
from affmap.results.files import read_maps
from affmap.results.setting import Setting
from affmap.results.tables import Results, join
from affmap.settings import ConfigError

SWEEP = ["model.context_size=0,2", "planner=cem", "training.snapshot_epochs=[1]", "report.snapshots=true"]
SPLITS = {
    "one job": ["members=6"],
    "six jobs": ["members=1", "seed=range(6)"],
    "three jobs": ["members=2", "seed=0,2,4"],
    "uneven jobs": ["members=1,5", "seed=0,1"],
}


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[Setting, ...]]:
    """Each split, complete, in a store that all share: so there is one data set."""
    folder = tmp_path_factory.mktemp("splits")
    found = {}
    for name, split in SPLITS.items():
        configs = jobs(folder, *SWEEP, *split)
        if name == "uneven jobs":
            configs = [config for config in configs if (config.members, config.seed) in ((1, 0), (5, 1))]
        found[name] = join([pipeline.run(config) for config in configs])
    assert len(list(folder.glob("store/data/*"))) == 1
    return found


def close(found: pd.DataFrame, expected: pd.DataFrame) -> None:
    pd.testing.assert_frame_equal(found, expected, check_exact=False, rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize("name", [name for name in SPLITS if name != "one job"])
def test_every_split_gives_the_tables_of_one_job(ran: dict[str, tuple[Setting, ...]], name: str) -> None:
    """Row by row, in the same order, to float rounding: matrices of other sizes are summed in another order."""
    assert len(ran[name]) == 2
    split, whole = Results(ran[name]), Results(ran["one job"])
    close(split.validation, whole.validation)
    close(split.runs, whole.runs)
    close(split.steps, whole.steps)
    assert split.runs[["context_size", "member", "run"]].equals(whole.runs[["context_size", "member", "run"]])


@pytest.mark.parametrize("name", [name for name in SPLITS if name != "one job"])
def test_every_split_gives_the_arrays_of_one_job(ran: dict[str, tuple[Setting, ...]], name: str) -> None:
    """Maps with their snapshots, trajectories, worlds: members in the same order."""
    for part, whole in zip(ran[name], ran["one job"], strict=True):
        for found, expected in zip(read_maps(part.map), read_maps(whole.map), strict=True):
            np.testing.assert_allclose(found, expected, atol=1e-3)
        split, one = Results((part,)), Results((whole,))
        for found, expected in zip(split.deviations(part), one.deviations(whole), strict=True):
            np.testing.assert_allclose(found, expected, atol=1e-3)
        for found, expected in zip(split.trajectories(part), one.trajectories(whole), strict=True):
            np.testing.assert_allclose(found, expected, atol=1e-3)
        assert split.run_layouts(part) == one.run_layouts(whole)
        assert len(split.provenance) == 1 + 4 * len(part.train)  # the data are shared


def test_the_order_of_jobs_does_not_matter(ran: dict[str, tuple[Setting, ...]]) -> None:
    """Reversed: the same folders in the same order."""
    alone = [
        Setting(job.values, {stage: (folder,) for stage, folder in zip(job.folders, folders, strict=True)})
        for job in ran["six jobs"]
        for folders in zip(6 * job.data, job.train, job.predict, job.map, job.control, strict=True)
    ]
    assert join(alone[::-1]) == ran["six jobs"][::-1]


@pytest.mark.parametrize("split", [["members=2", "seed=0,1"], ["members=1,2", "seed=0"]])
def test_a_member_in_two_jobs_is_refused(tmp_path: Path, split: Sequence[str]) -> None:
    """It would be counted twice."""
    told = r"member [01] would be in two jobs \(seed=0 members=\d and seed=[01] members=\d\)"
    with pytest.raises(ConfigError, match=told):
        read_sweep(line(tmp_path, "model.context_size=0,1", *split))


def test_two_jobs_with_the_same_results_are_refused(tmp_path: Path) -> None:
    told = r"^model.context_size=0 threads=1 and model.context_size=0 threads=2 have the same results; leave one of"
    with pytest.raises(ConfigError, match=told):
        read_sweep(line(tmp_path, "model.context_size=0,1", "threads=1,2"))


def test_a_split_sweep_has_one_report(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The real commands: a job for each member; the labels tell them apart, and the report counts two members."""
    monkeypatch.chdir(tmp_path)
    overrides = line(tmp_path, "model.context_size=0,1", "members=1", "seed=range(2)", "training.num_epochs=1")
    assert Sweep.read(overrides).labels == [f"model.context_size={c} seed={seed}" for c in (0, 1) for seed in (0, 1)]
    for entry in ("affmap", "affmap-report"):
        assert in_process(monkeypatch, entry, overrides) == 0, capsys.readouterr().err
    runs = pd.read_csv(tmp_path / "output/tables/runs.csv")
    assert runs.groupby("context_size")["member"].unique().map(list).tolist() == [[0, 1], [0, 1]]
    assert (tmp_path / "output/report.pdf").is_file()
