"""Types and signatures of public names, as type checkers, editors and `help` show them."""

import importlib.resources
import inspect
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import affmap

ROOT = Path(__file__).parents[1]

PROGRAM = """
import affmap
from affmap.control import RandomAgent
from affmap.model.registry import GRUSettings
from affmap.settings import Count, Positive, Settings, preset

planner = affmap.CEMPlanner(num_iterations=10)
agent = affmap.train("original", context_size=8, transition=GRUSettings(), training={"batch_size": 5})
other = affmap.load("exp1", context_size=4, planner="gradient")
runs = affmap.fly(agent, "fog", runs=2, starts=[0.2, 0.2])
table = affmap.evaluate({"mine": agent, "theirs": other, "none": RandomAgent()}, ["original", "fog"], runs=3)
distance: float = table["mean_distance"].mean()
affmap.plot.affordance_map(agent).set_title("a map")
affmap.plot.trajectories(runs)
circle = affmap.Circle(center=(1.5, 1), radius=0.2, effect="fog", channel="fog")
world = affmap.Layout.load("layout", "fog", circles=[circle])
stack = affmap.Stack(affmap.ModelSettings(context_size=3, transition=GRUSettings()), 4, (0, 1))
lookup = affmap.AffordanceMap.paint(stack, [world.map], 0.5)
pilot = affmap.Pilot(affmap.Agent(stack, lookup, planner, affmap.ControlSettings(beta=2), world.channels), world)
observation, info = affmap.VehicleEnv(world, affmap.Vehicle(mass=0.2)).reset(seed=1)
affmap.register_effect("wind", affmap.Effect("wind", "#c994c7", force=lambda way, velocity: -velocity))
affmap.register_metric("end", affmap.Metric("end", "u", "x (u)", lambda paths: paths.position[:, -1, 0]))


class Own(Settings, defaults="planner/own"):
    horizon: Count = preset()
    std: Positive


Own(std=0.1)
Own(horizon=3)  # wrong: call-arg
affmap.CEMPlanner(num_iteration=10)  # wrong: call-arg
affmap.CEMPlanner(num_iterations="10")  # wrong: arg-type
affmap.fly(agent, 3)  # wrong: arg-type
affmap.fly(agent)  # wrong: call-arg
affmap.plot.mapp(agent)  # wrong: attr-defined
affmap.Ensemble  # wrong: attr-defined
"""


def presets() -> list[tuple[str, str]]:
    """Module and name of the settings that have a file, as the source has them."""
    texts = {path: path.read_text("utf-8") for path in (ROOT / "affmap").rglob("*.py")}
    return [
        (".".join(path.relative_to(ROOT).with_suffix("").parts), name)
        for path, text in texts.items()
        for name in re.findall(r"^class (\w+)\(Settings, defaults=", text, re.MULTILINE)
    ]


def test_a_type_checker_knows_calls_and_their_mistakes(tmp_path: Path) -> None:
    """mypy, as strict as it can be: its marked lines alone are wrong. Settings with a file need no keys in a call."""
    assert ("affmap.planning.cem", "CEMPlanner") in presets()
    program = PROGRAM + "".join(f"from {module} import {name}\n{name}()\n" for module, name in presets())
    (tmp_path / "program.py").write_text(program)
    command = [sys.executable, "-m", "mypy", "--strict", "--follow-imports=silent", "--cache-dir=cache", "program.py"]
    environment = {**os.environ, "MYPYPATH": str(ROOT)}
    result = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
    found = dict(re.findall(r"^program\.py:(\d+): error: .*\[(.+)\]$", result.stdout, re.MULTILINE))
    wrong = {str(n): line.rpartition(": ")[2] for n, line in enumerate(program.splitlines(), 1) if "# wrong" in line}
    assert found == wrong, result.stdout + result.stderr


def test_types_come_with_the_installed_package() -> None:
    """PEP 561: without this file, checkers ignore the types of a package."""
    assert (importlib.resources.files("affmap") / "py.typed").is_file()


def called(name: str, public: Any) -> Iterator[tuple[str, Any]]:
    """Name -> what a user calls by it: a function, a class and its public methods, or all of these in a folder."""
    if inspect.isfunction(public):
        yield name, public
    elif inspect.isclass(public) and not issubclass(public, Exception):
        yield name, public
        for method, function in inspect.getmembers(public):
            module = getattr(function, "__module__", None) or ""
            if method[0] != "_" and inspect.isroutine(function) and module.startswith("affmap."):
                yield f"{name}.{method}", function
    for inner in getattr(public, "__all__", ()):
        yield from called(f"{name}.{inner}", getattr(public, inner))


@pytest.mark.parametrize("name", affmap.__all__)
def test_signatures_can_be_read(name: str) -> None:
    """Types have the names that they have in the source: no modules, nothing that an alias stands for, no limits."""
    walls = r"affmap\.|collections\.|typing\.|numpy\.|pandas\.|pathlib\.|torch\._|Annotated|Union\[|Optional\["
    for each, function in called(name, getattr(affmap, name)):
        signature = str(inspect.signature(function))
        assert not re.search(walls, signature), f"`from __future__ import annotations` for {each}{signature}"
