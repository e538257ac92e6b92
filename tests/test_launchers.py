"""The same sweep on a cluster: Ray and submitit for real on this machine, SLURM by a stand-in that runs its scripts."""

import os
import subprocess
from pathlib import Path

import pytest
from commands import COMMAND, ENVIRONMENT, jobs, line

from affmap import pipeline

pytestmark = pytest.mark.slow

SWEEP = ["model.context_size=0,1"]

SBATCH = """#!/bin/sh
# Keeps the script, and runs each task of its array, as SLURM would somewhere.
for script; do :; done
cp "$script" "$CLUSTER/sbatch.sh"
for task in $(seq 0 "$(sed -n 's/^#SBATCH --array=0-\\([0-9]*\\)%.*/\\1/p' "$script")"); do
  SLURM_JOB_ID=7 SLURM_ARRAY_JOB_ID=7 SLURM_ARRAY_TASK_ID=$task SLURM_NTASKS=2 SLURM_PROCID=0 SLURM_LOCALID=0 \
    SLURM_NODEID=0 SLURM_JOB_NUM_NODES=1 SLURM_JOB_NODELIST=localhost sh "$script" > "$CLUSTER/$task.log" 2>&1 &
done
echo "Submitted batch job 7"
"""
SRUN = """#!/bin/sh
# Runs what comes after its own options.
while [ "${1#-}" != "$1" ]; do case $1 in --output|--error) shift 2;; *) shift;; esac; done
exec "$@"
"""


def sweep(folder: Path, *overrides: str, environment: dict[str, str] | None = None) -> None:
    """Run the sweep by the console script; every setting is complete afterwards, and everything was made once."""
    folder.mkdir()
    arguments = [each for each in line(folder, *SWEEP) if not each.startswith("hydra.launcher.n_jobs")]
    result = subprocess.run(
        [COMMAND, *arguments, *overrides],
        cwd=folder,
        capture_output=True,
        text=True,
        env=ENVIRONMENT | (environment or {}),
        timeout=300,
    )
    assert result.returncode == 0, result.stdout + result.stderr
    logs = "".join(path.read_text() for path in folder.rglob("affmap.log"))
    assert logs.count("exploration of original: 4 sequences") == 1 and logs.count("training of 2 members") == 2


def results(folder: Path) -> dict[str, bytes]:
    """Tables and weights of all jobs."""
    found = {}
    for config in jobs(folder, *SWEEP):
        job = pipeline.find(config)
        assert job is not None
        for path in (*job.train[0].glob("*.safetensors"), job.train[0] / "validation.csv", job.control[0] / "runs.csv"):
            found[str(path.relative_to(folder))] = path.read_bytes()
    return found


@pytest.fixture(scope="module")
def expected(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """What the sweep gives on the local cores."""
    folder = tmp_path_factory.mktemp("local") / "sweep"
    sweep(folder)
    return results(folder)


def test_ray(tmp_path: Path, expected: dict[str, bytes]) -> None:
    """A cluster of this machine: the results of the local cores, byte by byte."""
    pytest.importorskip("ray")
    sweep(tmp_path / "sweep", "hydra/launcher=ray")
    assert results(tmp_path / "sweep") == expected


def test_submitit_s_local_executor(tmp_path: Path, expected: dict[str, bytes]) -> None:
    """All jobs start at once: the results of the local cores, byte by byte."""
    pytest.importorskip("submitit")
    sweep(tmp_path / "sweep", "hydra/launcher=submitit_local")
    assert results(tmp_path / "sweep") == expected


@pytest.mark.parametrize("launcher", ["slurm", "submitit_slurm"])
def test_slurm_s_script(tmp_path: Path, expected: dict[str, bytes], launcher: str) -> None:
    """The script that SLURM would get, and what comes of it: the results of the local cores, byte by byte."""
    pytest.importorskip("submitit")
    for name, text in {"sbatch": SBATCH, "srun": SRUN, "sacct": "#!/bin/sh\n", "scontrol": "#!/bin/sh\n"}.items():
        (tmp_path / name).write_text(text)
        (tmp_path / name).chmod(0o755)
    environment = {"PATH": f"{tmp_path}:{os.environ['PATH']}", "CLUSTER": str(tmp_path)}
    sweep(tmp_path / "sweep", f"hydra/launcher={launcher}", "hydra.launcher.partition=short", environment=environment)
    assert results(tmp_path / "sweep") == expected
    script = (tmp_path / "sbatch.sh").read_text()
    print(script)
    options = {row.removeprefix("#SBATCH --") for row in script.splitlines() if row.startswith("#SBATCH")}
    assert {"array=0-1%2", "partition=short"} <= options
    if launcher == "slurm":
        assert {"cpus-per-task=1", "mem=4GB", "time=240", "signal=USR2@60", "job-name=single"} <= options
