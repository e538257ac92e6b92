"""Files of completed stages: for each its type, its writer and its reader, side by side.

Axes: M members, T recorded steps, B = M x 4 runs, H planning horizon, C context code, Y and X rows and columns of a
grid (row 0 has the smallest y). Lengths are in units (u), times in steps. Readers raise ConfigError where a file is
corrupted, and execute nothing in it. The data set has its reader in `affmap.data.batches`, weights in
`affmap.model.weights`.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from affmap.env.layout import Layout
from affmap.env.scene import Scene
from affmap.settings.messages import ConfigError
from affmap.store.files import guarded_read, read_arrays, read_json
from affmap.store.provenance import PROVENANCE

COVERAGE, VALIDATION, EXPERIENCE = "coverage.npz", "validation.csv", "experience.npz"
STEPS, DEVIATIONS = "steps.csv", "deviations.npz"
MAPS, BLOCKS, SHARES = "maps.npz", "blocks.npz", "shares.csv"
RUNS, TRAJECTORIES, LAYOUTS, RECALL = "runs.csv", "trajectories.npz", "layouts.json", "recall.npz"
"""Names of the files."""

VALIDATION_COLUMNS = ["member", "epoch", "training_nll", "validation_nll"]

Floats = NDArray[np.floating[Any]]


class Exploration(NamedTuple):
    """Places visited by the data set, in each of W training layouts."""

    counts: NDArray[np.integer]
    """`[W, Y, X]` recorded steps in each cell of side `affmap.env.geometry.CELL`."""
    free: NDArray[np.bool_]
    """`[W, Y, X]`: can the vehicle's centre be at the cell's centre?"""
    coverage: Floats
    """`[W]`, share of the free cells that were visited."""


def write_coverage(folder: Path, parts: Sequence[dict[str, np.ndarray]]) -> Exploration:
    """Write the results of `affmap.data.collect.coverage` in each of W layouts; returns them together."""
    exploration = Exploration(**{key: np.stack([part[key] for part in parts]) for key in Exploration._fields})
    _write_arrays(folder / COVERAGE, exploration)
    return exploration


def read_coverage(folder: Path) -> Exploration:
    """Read the places visited by the data set."""
    return _read_arrays(Exploration, folder / COVERAGE)


def write_validation(folder: Path, table: pd.DataFrame) -> None:
    """Write losses: a row for each member and epoch (and trial), columns `VALIDATION_COLUMNS` among others."""
    table.to_csv(folder / VALIDATION, index=False, float_format="%.6f")


def read_validation(folder: Path, members: Sequence[int] | None = None) -> pd.DataFrame:
    """Read losses of some members, or of all: a row for each and each epoch, columns `VALIDATION_COLUMNS`."""
    table = _read_table(folder / VALIDATION, VALIDATION_COLUMNS)[VALIDATION_COLUMNS]
    return table if members is None else table[table["member"].isin(members)].reset_index(drop=True)


class Experience(NamedTuple):
    """Places of A agents that learn online, in each of R rounds; round r is in layout r modulo W."""

    counts: NDArray[np.integer]
    """`[A, R, Y, X]` steps that ended in each cell of side `affmap.env.geometry.CELL`."""
    free: NDArray[np.bool_]
    """`[W, Y, X]`: can the vehicle's centre be at the cell's centre?"""
    touching: Floats
    """`[A, R]` share of the steps at whose end the vehicle touched a surface."""
    in_fog: Floats
    """`[A, R]` share of the steps at whose end it was in fog."""
    agent: NDArray[np.integer]
    """`[A]` seed of the first member of its committee."""
    reached: NDArray[np.integer] | None = None
    """`[A, R]` goals that were reached; None for agents that have none."""

    @property
    def steps(self) -> NDArray[np.integer]:
        """`[R]` steps of an agent until the end of each round."""
        return self.counts[0].sum((1, 2)).cumsum()

    @property
    def goals(self) -> Floats | None:
        """`[A, R]` goals that were reached in each step of a round, on average; None for agents that have none."""
        return None if self.reached is None else self.reached / np.diff(self.steps, prepend=0)

    @property
    def coverage(self) -> Floats:
        """`[A, R]` share of the free cells of all layouts that an agent has visited by the end of each round."""
        num_layouts = len(self.free)
        counts = np.zeros((num_layouts, *self.counts.shape), self.counts.dtype)
        for number in range(self.counts.shape[1]):
            counts[number % num_layouts, :, number] = self.counts[:, number]
        visited = counts.cumsum(2) > 0
        return np.count_nonzero(visited & self.free[:, None, None], (0, 3, 4)) / np.count_nonzero(self.free)


def write_experience(folder: Path, experience: Experience) -> None:
    """Write where agents were that learn online."""
    _write_arrays(folder / EXPERIENCE, experience)


def read_experience(folders: Sequence[Path]) -> Experience:
    """Read where all agents were that learn online, which may have been divided among several stages."""
    parts = [_read_arrays(Experience, folder / EXPERIENCE) for folder in folders]
    joined = {
        key: np.concatenate([getattr(part, key) for part in parts])
        for key in Experience._fields
        if key != "free" and getattr(parts[0], key) is not None
    }
    return parts[0]._replace(**joined)


KINDS = ("free", "touching", "entering", "inside", "leaving")
"""Kinds of steps: free, touching a surface at the end, entering fog, inside fog, leaving it."""

EVERYWHERE = "(all)"
"""Entry of the column `world` for all training layouts together."""

STEP_COLUMNS = ["member", "epoch", "world", "kind", "steps", "mean", "median"]


def write_steps(folder: Path, table: pd.DataFrame) -> None:
    """Write validation losses by kind of step: a row for each member, epoch, world and kind, `STEP_COLUMNS`."""
    table[STEP_COLUMNS].to_csv(folder / STEPS, index=False, float_format="%.6f")


def read_steps(folder: Path) -> pd.DataFrame:
    """Read validation losses by kind of step, columns `STEP_COLUMNS`; losses in nats."""
    return _read_table(folder / STEPS, STEP_COLUMNS)[STEP_COLUMNS]


class Deviations(NamedTuple):
    """Standard deviations that all members of one training predict for a step at the nodes of a map."""

    std: Floats
    """`[M, Y, X, 2]` in u/step, of a step that begins at rest with closed throttles."""
    x: Floats
    """`[X]` in u."""
    y: Floats
    """`[Y]` in u."""
    member: NDArray[np.integer]
    """`[M]`."""

    @property
    def nodes(self) -> Floats:
        """`[Y, X, 2]` positions of the nodes, u."""
        return np.stack(np.meshgrid(self.x, self.y), axis=-1)


def write_deviations(folder: Path, deviations: Deviations) -> None:
    """Write predicted deviations."""
    _write_arrays(folder / DEVIATIONS, deviations)


def read_deviations(folders: Sequence[Path]) -> Deviations:
    """Read the predicted deviations of all members, which may have been divided among several stages."""
    parts = [_read_arrays(Deviations, folder / DEVIATIONS) for folder in folders]
    std, member = np.concatenate([part.std for part in parts]), np.concatenate([part.member for part in parts])
    return parts[0]._replace(std=std, member=member)


class Maps(NamedTuple):
    """Affordance maps of all members of one training."""

    codes: Floats
    """`[M, Y, X, C]` context codes at the nodes."""
    initial_codes: Floats
    """`[M, Y, X, C]`, the same before training."""
    snapshot_codes: Floats
    """`[E, M, Y, X, C]`, the same after E epochs of the training, the last one included; E is 0 where none was kept."""
    epochs: NDArray[np.integer]
    """`[E]`, numbers of those epochs."""
    x: Floats
    """`[X]` in u."""
    y: Floats
    """`[Y]` in u."""
    member: NDArray[np.integer]
    """`[M]`."""

    @property
    def untrained(self) -> Maps:
        """The members' maps before training."""
        return self._replace(codes=self.initial_codes)

    @property
    def snapshots(self) -> dict[int, Maps]:
        """Epoch -> the members' maps after it."""
        return {int(e): self._replace(codes=codes) for e, codes in zip(self.epochs, self.snapshot_codes, strict=True)}

    @property
    def nodes(self) -> Floats:
        """`[Y, X, 2]` positions of the nodes, u."""
        return np.stack(np.meshgrid(self.x, self.y), axis=-1)


def write_maps(folder: Path, maps: Maps) -> None:
    """Write affordance maps."""
    _write_arrays(folder / MAPS, maps)


def read_maps(folders: Sequence[Path]) -> Maps:
    """Read the affordance maps of all members, which may have been divided among several stages."""
    parts = [_read_arrays(Maps, folder / MAPS) for folder in folders]
    return parts[0]._replace(
        codes=np.concatenate([part.codes for part in parts]),
        initial_codes=np.concatenate([part.initial_codes for part in parts]),
        snapshot_codes=np.concatenate([part.snapshot_codes for part in parts], axis=1 if len(parts[0].epochs) else 0),
        member=np.concatenate([part.member for part in parts]),
    )


class Blocks(NamedTuple):
    """Effects of the B blocks of a member's codes, each alone: its own code is all that is not 0.

    Effects depend on motion and action; all are means over some of these (`affmap.pipeline.blocks`).
    """

    change: Floats
    """`[B, Y, X, 2]` in u/step: change of the predicted mean."""
    spread: Floats
    """`[B, Y, X]` in u/step: deviation of this change from its mean, as motion and action vary."""
    deviation: Floats
    """`[B, Y, X]` in u/step: standard deviation that the block adds to a coordinate, root of the mean square."""
    x: Floats
    """`[X]` in u."""
    y: Floats
    """`[Y]` in u."""

    @property
    def nodes(self) -> Floats:
        """`[Y, X, 2]` positions of the nodes, u."""
        return np.stack(np.meshgrid(self.x, self.y), axis=-1)


SHARE_COLUMNS = ["member", "effect", "block", "share"]


def write_blocks(folder: Path, blocks: Blocks, shares: pd.DataFrame) -> None:
    """Write the effects of blocks: of the first member on a map, and of all members by property.

    Args:
        folder: of the stage.
        blocks: those of the first member.
        shares: a row for each member, effect of circles and block (from 1), `SHARE_COLUMNS`: the share of the block in
            what all blocks do where such circles act.
    """
    _write_arrays(folder / BLOCKS, blocks)
    shares[SHARE_COLUMNS].to_csv(folder / SHARES, index=False, float_format="%.6f")


def read_blocks(folder: Path) -> Blocks:
    """Read the effects of the first member's blocks on a map."""
    return _read_arrays(Blocks, folder / BLOCKS)


def read_shares(folder: Path) -> pd.DataFrame:
    """Read the shares of blocks in what all do where circles of each effect act, columns `SHARE_COLUMNS`."""
    return _read_table(folder / SHARES, SHARE_COLUMNS)[SHARE_COLUMNS]


class Trajectories(NamedTuple):
    """Recorded runs of control; absolute positions in u."""

    position: Floats
    """`[B, T + 1, 2]`."""
    goal: Floats
    """`[B, 2]`."""
    planned_position: Floats
    """`[B, T, H, 2]` mean of the predicted positions at each step."""
    planned_std: Floats
    """`[B, T, H, 2]` standard deviation of the predicted positions (accumulated over the horizon)."""
    action: Floats
    """`[B, T, 4]` opening of the throttles during the step, 0 to 1."""
    prediction_error: Floats
    """`[B, T]` negative log-likelihood of the change of position in the step, nats."""
    touching: NDArray[np.bool_]
    """`[B, T]`: did the vehicle touch a surface at the end of the step?"""
    in_fog: NDArray[np.bool_]
    """`[B, T]`: was the vehicle in fog at the end of the step?"""
    reached: NDArray[np.bool_]
    """`[B, T]`: was it at the goal then?"""
    member: NDArray[np.integer]
    """`[B]`."""
    run: NDArray[np.integer]
    """`[B]`."""

    def scene(self, index: int, step: int, layout: Layout, radius: float) -> Scene:
        """The moment at which run `index` of the B makes the plan of a step, for a vehicle of `radius` (u).

        Doors of the `layout` in which the run began are gone once it has been at a key.
        """
        past, moment = self.position[index, : step + 1], (index, step)
        layout = layout.opened if layout.are_open(past)[-1] else layout
        lost = bool(step and self.in_fog[index, step - 1])
        scene = Scene(layout, radius, past[-1], self.goal[index], past=past, start=past[0], in_fog=lost)
        return scene._replace(
            action=self.action[moment], path=self.planned_position[moment], std=self.planned_std[moment]
        )


def write_trajectories(folder: Path, arrays: dict[str, np.ndarray]) -> None:
    """Write the arrays of `Trajectories`, in the order in which they come."""
    np.savez_compressed(folder / TRAJECTORIES, allow_pickle=False, **arrays)


def read_trajectories(folders: Sequence[Path]) -> Trajectories:
    """Read recorded runs of all members."""
    parts = [_read_arrays(Trajectories, folder / TRAJECTORIES) for folder in folders]
    return Trajectories(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))


class Recall(NamedTuple):
    """Memorised maps of B runs, which follow E steps of an earlier flight (E may be 0)."""

    error: Floats
    """`[B, 1 + E + T]`, error of the codes in memory, before the first step and at each, where codes have changed since
    the world was explored (everywhere, if none have): distance from the true codes, as a share of theirs from 0."""
    earlier: NDArray[np.integer]
    """`[]`, E."""
    true: Floats
    """`[Y, X, C]`, codes of the first member at the nodes of a map."""
    at_first: Floats
    """`[Y, X, C]`, what it remembers before the first step."""
    at_last: Floats
    """`[Y, X, C]`, what it remembers at the end of that of its runs after which its error is smallest."""
    best: NDArray[np.integer]
    """`[]`, the number of this run, from 0."""
    x: Floats
    """`[X]` in u."""
    y: Floats
    """`[Y]` in u."""
    member: NDArray[np.integer]
    """`[B]`."""


def write_recall(folder: Path, recall: Recall) -> None:
    """Write what is known of memorised maps."""
    _write_arrays(folder / RECALL, recall)


def read_recall(folders: Sequence[Path]) -> Recall:
    """Read what is known of the memorised maps of all members."""
    parts = [_read_arrays(Recall, folder / RECALL) for folder in folders]
    joined = {key: np.concatenate([getattr(part, key) for part in parts]) for key in ("error", "member")}
    return parts[0]._replace(**joined)


LAYOUT_COLUMNS = ["crossable", "lookup_error"]
"""Columns of a table of runs that follow from layouts: whether there is a way, and the error of the planner's codes."""


def write_runs(
    folder: Path,
    setting: Mapping[str, str | int | float],
    table: pd.DataFrame,
    layout_values: Sequence[Sequence[Any] | np.ndarray],
) -> None:
    """Write a table of runs.

    Args:
        folder: of the stage.
        setting: columns before all others, the same for all runs.
        table: one row a run.
        layout_values: the columns `LAYOUT_COLUMNS`, after all others.
    """
    before = pd.DataFrame(dict(setting), index=table.index)
    after = pd.DataFrame(dict(zip(LAYOUT_COLUMNS, layout_values, strict=True)), index=table.index)
    before.join(table).join(after).to_csv(folder / RUNS, index=False, float_format="%.6f")


def read_runs(folder: Path, columns: Sequence[str]) -> pd.DataFrame:
    """Read a table of runs, a row each; it must have `columns`."""
    return _read_table(folder / RUNS, columns)


def write_layouts(folder: Path, layouts: Sequence[Layout]) -> None:
    """Write the layout of each of B runs."""
    (folder / LAYOUTS).write_text(json.dumps([layout.model_dump(mode="json") for layout in layouts]), "utf-8")


def read_layouts(folder: Path) -> list[Layout]:
    """Read the layout of each of B runs."""
    with guarded_read(folder / LAYOUTS):
        texts = [json.dumps(layout) for layout in read_json(folder / LAYOUTS)]
        layouts = {text: Layout.model_validate_json(text) for text in dict.fromkeys(texts)}  # most runs share theirs
        return [layouts[text] for text in texts]


def read_origin(folder: Path) -> dict[str, Any]:
    """Read the provenance of a stage, with at least its name, digest and configuration."""
    with guarded_read(folder / PROVENANCE):
        record: dict[str, Any] = read_json(folder / PROVENANCE)
        for key in ("stage", "digest", "config"):
            record[key]
        return record


Record = TypeVar("Record", Maps, Blocks, Deviations, Experience, Exploration, Recall, Trajectories)


def _write_arrays(path: Path, record: Maps | Blocks | Deviations | Experience | Exploration | Recall) -> None:
    there = {field: array for field, array in record._asdict().items() if array is not None}
    np.savez_compressed(path, allow_pickle=False, **there)


def _read_arrays(record: type[Record], path: Path) -> Record:
    arrays = read_arrays(path)
    with guarded_read(path):
        optional = {field for field in record._field_defaults if field not in arrays}
        return record(**{field: arrays[field][()] for field in record._fields if field not in optional})


def _read_table(path: Path, columns: Sequence[str]) -> pd.DataFrame:
    with guarded_read(path):
        table = pd.read_csv(path)
    if missing := [column for column in columns if column not in table]:
        raise ConfigError(
            f"{path} lacks the columns {missing}: another version wrote it; remove its folder and run again."
        )
    return table
