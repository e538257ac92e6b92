"""Notes of sweeps in their folders, read as they were written. `test_safety.py` has those of strangers."""

import json
import os
from pathlib import Path

import pytest

from affmap.config.notes import NOTE, read_note, write_note
from affmap.settings import ConfigError
from affmap.store.provenance import with_checksum


def test_a_note_of_a_sweep_is_read_if_its_checksum_is_right(tmp_path: Path) -> None:
    write_note(tmp_path, ["experiment=exp1"])
    assert read_note(tmp_path) == ["experiment=exp1"]
    for note in ({"overrides": ["experiment=exp2"]}, with_checksum({"overrides": 3}), with_checksum({}), [], 3):
        (tmp_path / NOTE).write_text(json.dumps(note))
        with pytest.raises(ConfigError, match="is corrupted"):
            read_note(tmp_path)


def test_a_note_of_one_s_own_is_read(tmp_path: Path) -> None:
    """A sweep's keys, references to keys, and a search's keys; by hand."""
    own = ["experiment=exp1", "title='${name}, once more'", "model.context_size=range(3)", "~baselines"]
    search = ["hydra/sweeper=hyperopt", "hydra.sweeper.num_trials=3", "hydra.sweep.dir=here"]
    write_note(tmp_path, [*own, *search, "hydra/launcher=basic"])
    assert read_note(tmp_path) == [*own, *search]


def test_a_note_that_is_no_file_is_not_read(tmp_path: Path) -> None:
    """Reading a pipe would never end."""
    (tmp_path / "jobs").mkdir()
    os.mkfifo(tmp_path / NOTE)
    with pytest.raises(ConfigError, match=r"holds no note of a sweep \(jobs/sweep\.json\)"):
        read_note(tmp_path)
