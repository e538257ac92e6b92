"""The commands do without what takes seconds to import as long as there is nothing to compute."""

import subprocess
import sys
from pathlib import Path

import pytest
from commands import ENVIRONMENT, command, in_process, line

SLOW = ("torch", "lightning", "scipy", "matplotlib", "gymnasium", "Box2D", "hyperopt")
SWEEP = ["planner=cem", "model.context_size=1"]
CALL = """
import sys
from affmap.cli.{module} import main
sys.argv[0] = "affmap"
main()
print("imported:", *(name for name in {slow} if name in sys.modules))
"""


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A sweep that is complete, and its report."""
    folder = tmp_path_factory.mktemp("swept")
    assert command(folder, *SWEEP).returncode == 0
    with pytest.MonkeyPatch.context() as patch:
        assert in_process(patch, "affmap-report", line(folder, *SWEEP)) == 0
    return folder


@pytest.mark.parametrize(
    ("module", "flags", "message"),
    [
        ("run", [], "1 of 1 settings are complete."),
        ("status", [], "1 of 1 settings complete"),
        ("report", [], "The report is"),
        ("report", ["--check"], "every file is as it was written"),
    ],
)
def test_nothing_slow_is_imported_where_all_is_complete(
    swept: Path, module: str, flags: list[str], message: str
) -> None:
    """In a process of its own, by what Python has imported at the end."""
    code = CALL.format(module=module, slow=SLOW)
    arguments = [sys.executable, "-c", code, *line(swept, *SWEEP), *flags]
    result = subprocess.run(arguments, capture_output=True, text=True, env=ENVIRONMENT, timeout=120)
    assert result.returncode == 0, result.stderr
    assert message in result.stdout
    assert result.stdout.splitlines()[-1] == "imported:"
