"""The key `compiled`: how a job computes, and not what."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from commands import line

from affmap import compiled, pipeline
from affmap.config import sweep
from affmap.pipeline.job import stages


@pytest.mark.parametrize("planner", ["cem", "gradient"])
def test_a_job_is_the_same_with_and_without_compiled_loops(tmp_path: Path, planner: str) -> None:
    """To rounding, a few steps after each start; and by the same digests."""
    jobs = {}
    for wanted in (True, False):
        overrides = line(tmp_path / str(wanted), "model.context_size=3", f"planner={planner}", f"compiled={wanted}")
        (config,) = sweep.jobs(sweep.complete(overrides))
        jobs[wanted] = config, pipeline.run(config)
        assert compiled.enabled() is wanted
    compiled.use(True)
    (one, with_loops), (other, without) = jobs[True], jobs[False]
    assert [stage.digest for stage in stages(one)] == [stage.digest for stage in stages(other)]
    pd.testing.assert_frame_equal(
        pd.read_csv(with_loops.control[0] / "runs.csv"), pd.read_csv(without.control[0] / "runs.csv"), atol=1e-3
    )
    mine, its = (np.load(job.control[0] / "trajectories.npz") for job in (with_loops, without))
    np.testing.assert_allclose(mine["action"], its["action"], atol=1e-3)
