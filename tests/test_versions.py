"""Numbers of stages beside those of a stored toy run: who changes them raises the version of the stage's rules.

`python tests/test_versions.py` stores the numbers of raised versions anew.
"""

import json
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from commands import line
from safetensors.numpy import load_file

from affmap import pipeline
from affmap.config import sweep
from affmap.pipeline.policy import WEIGHTS
from affmap.pipeline.stage import BLOCKS, CONTROL, DATA, MAP, POLICIES, PREDICT, TRAIN, StageDefinition
from affmap.results.setting import Setting

STORED = Path(__file__).parent / "golden" / "toy"
VERSIONS = STORED / "versions.json"
DEFINITIONS = {definition.name: definition for definition in (DATA, TRAIN, PREDICT, MAP, BLOCKS, CONTROL)}
DEFINITIONS |= {f"policy_of_{source}": POLICIES[source] for source in ("data", "plans")}
TOY = ["world=fog", "acts=rim", "training.snapshot_epochs=[1]"]
SWEEP = [*TOY, "model.context_size=2", "planner=cem,gradient"]
WITH_BLOCKS = [*TOY, "model.context_size=4", "planner=cem", "model/transition=split"]
WITH_POLICIES = [*TOY, "model.context_size=2", "planner=cem", "rival=cloning,distilled", "rival_share=0.002"]
TOLERANCE = 1e-3
"""Relative and absolute, as in `tests/test_splits.py`: another processor rounds differently."""


def moments(folder: Path, name: str, arrays: tuple[str, ...]) -> pd.DataFrame:
    """Means and spreads of arrays, a row for each place along the first axis."""
    content = np.load(folder / name)
    rows = [
        {"array": array, "place": place, "mean": part.mean(), "spread": part.std()}
        for array in arrays
        for place, part in enumerate(content[array].astype(float))
    ]
    return pd.DataFrame(rows)


def weights(job: Setting) -> pd.DataFrame:
    """Means and spreads of the weights of policies."""
    arrays = load_file(job.folders["policy"][0] / WEIGHTS)
    rows = [{"array": key, "mean": float(part.mean()), "spread": float(part.std())} for key, part in arrays.items()]
    return pd.DataFrame(rows)


NUMBERS: dict[str, Callable[[Setting], pd.DataFrame]] = {
    "data": lambda job: moments(job.data[0], "dataset.npz", ("position", "action", "view")),
    "train": lambda job: pd.read_csv(job.train[0] / "validation.csv"),
    "predict": lambda job: pd.read_csv(job.predict[0] / "steps.csv"),
    "map": lambda job: moments(job.map[0], "maps.npz", ("codes", "initial_codes")),
    "blocks": lambda job: pd.read_csv(job.blocks[0] / "shares.csv"),
    "policy_of_data": weights,
    "policy_of_plans": weights,
    "control": lambda job: pd.read_csv(job.control[0] / "runs.csv"),
}
"""Stage -> its numbers as a table."""


def run(folder: Path) -> dict[str, pd.DataFrame]:
    """The numbers of the toy run, stage by stage; those of control are of both planners, others of further jobs."""
    lines = [line(folder, *overrides) for overrides in (SWEEP, WITH_BLOCKS, WITH_POLICIES)]
    *jobs, other, cloning, distilled = [
        pipeline.run(config) for each in lines for config in sweep.jobs(sweep.complete(each))
    ]
    chosen = {"control": jobs, "blocks": [other]} | {"policy_of_data": [cloning], "policy_of_plans": [distilled]}
    return {
        stage: pd.concat([read(job) for job in chosen.get(stage, jobs[:1])], ignore_index=True)
        for stage, read in NUMBERS.items()
    }


def stored(stage: str) -> pd.DataFrame:
    return pd.read_csv(STORED / f"{stage}.csv")


def versions_of(stage: str) -> dict[str, int]:
    """The versions of a stage's rules, and of those that it starts from."""
    definition: StageDefinition | None = DEFINITIONS[stage]
    versions = {}
    while definition:
        versions[definition.name] = definition.version
        definition = definition.needs
    return versions


def problem(stage: str, numbers: pd.DataFrame, known: pd.DataFrame, versions: dict[str, int]) -> str:
    """What is to be done about the numbers of a stage; empty where they are those that are known, of `versions`."""
    if versions_of(stage) != versions:
        return f"numbers of stage {stage} are stored of the versions {versions}: python tests/test_versions.py"
    try:
        pd.testing.assert_frame_equal(numbers, known, check_exact=False, rtol=TOLERANCE, atol=TOLERANCE)
    except AssertionError as error:
        needs = DEFINITIONS[stage].needs
        earlier = f" (or only that of {needs.name}, where its numbers changed, too)" if needs else ""
        return f"numbers of stage {stage} changed: raise its version{earlier}; {' '.join(str(error).split())}"
    return ""


@pytest.fixture(scope="module")
def numbers(tmp_path_factory: pytest.TempPathFactory) -> dict[str, pd.DataFrame]:
    return run(tmp_path_factory.mktemp("toy"))


@pytest.mark.parametrize("stage", NUMBERS)
def test_numbers_are_those_of_the_version(numbers: dict[str, pd.DataFrame], stage: str) -> None:
    """Golden: stored when the version was raised."""
    versions = json.loads(VERSIONS.read_text("utf-8"))
    assert not problem(stage, numbers[stage], stored(stage), versions[stage])


def raised(definition: StageDefinition) -> StageDefinition:
    return replace(definition, version=definition.version + 1)


@pytest.mark.parametrize("stage", NUMBERS)
def test_other_numbers_are_reported(stage: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The first number of the stored table is another one; with a raised version, also of an earlier stage, it may."""
    known, versions = stored(stage), versions_of(stage)
    column = known.select_dtypes("float").columns[0]
    changed = known.copy()
    changed.loc[0, column] += 0.1
    assert problem(stage, changed, known, versions).startswith(f"numbers of stage {stage} changed: raise its version")
    monkeypatch.setitem(DEFINITIONS, stage, raised(DEFINITIONS[stage]))
    assert "are stored of the versions" in problem(stage, changed, known, versions)
    monkeypatch.undo()
    if needs := DEFINITIONS[stage].needs:
        monkeypatch.setitem(DEFINITIONS, stage, replace(DEFINITIONS[stage], needs=raised(needs)))
        assert "are stored of the versions" in problem(stage, changed, known, versions)


def write() -> None:
    """Store the numbers of the stages whose versions are new; refuse changed numbers of old versions."""
    versions = json.loads(VERSIONS.read_text("utf-8")) if VERSIONS.is_file() else {}
    with tempfile.TemporaryDirectory() as folder:
        tables = run(Path(folder))
    same = [stage for stage in tables if versions_of(stage) == versions.get(stage)]
    if problems := [
        words for stage in same if (words := problem(stage, tables[stage], stored(stage), versions[stage]))
    ]:
        raise SystemExit("\n".join(problems))
    for stage in tables.keys() - set(same):
        tables[stage].to_csv(STORED / f"{stage}.csv", index=False, float_format="%.6f", lineterminator="\n")
    lines = ",\n".join(f' "{stage}": {json.dumps(versions_of(stage))}' for stage in tables)
    VERSIONS.write_text(f"{{\n{lines}\n}}\n", "utf-8")


if __name__ == "__main__":
    write()
