"""Bad input: every key of the configuration with bad values of every kind, and command lines that mean nothing.

Each ends in sentences and status 2, and nothing is run. `AFFMAP_FUZZ=<factor>` tries that many times as many examples,
and others at every call.
"""

import datetime
import json
import math
import os
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from copy import deepcopy
from itertools import permutations
from pathlib import Path
from typing import Any, NoReturn

import pytest
from commands import COMMANDS
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pydantic import BaseModel

from affmap.cli import run
from affmap.config import compose as composing
from affmap.config import memory, sweep
from affmap.config.memory import LIMIT_GIB, demands
from affmap.config.root import Config, plain
from affmap.env.body import MAX_SPEED, MIN_RADIUS, MIN_SPEED
from affmap.pipeline.job import stages
from affmap.settings import ConfigError, check_line, lies_in, read

FACTOR = int(os.environ.get("AFFMAP_FUZZ", 0))
Place = tuple[str | int, ...]

DEEP: list[Any] = []
for _ in range(50):
    DEEP = [DEEP]

BAD: dict[str, list[Any]] = {
    "type": [None, True, False, datetime.date(2026, 1, 1), datetime.datetime(2026, 1, 1, 12), b"bytes", object(), 1j],
    "text for something else": ["", " ", "many", "nan", "inf", "-inf", "1e400", "0x10", "None", "null", "[1, 2]", "~"],
    "container": [[], {}, (), set(), [[]], [{}], {"": ""}, {"a": {"b": [1, None]}}, {1: 2}, [1, "a", None], DEEP],
    "not a number": [math.nan, math.inf, -math.inf],
    "huge": [10**12, 10**19, 2**64, 10**400, 10**4000, 1e13, 1e308, "1" * 5000],
    "negative": [-1, -0.5, -(10**12), -(10**400), -1e308],
    "tiny": [0, 0.0, -0.0, 5e-324, -5e-324, 1e-300],
    "unicode": ["a\0b", "a\nb", "a\r", "\x1b[31mred", "\ud800", "\u202eevil", "\u2028", "ﷺ" * 200, "٣", "𝟙", "\ufffe"],
    "path": [
        "../../etc",
        "/",
        "..",
        ".",
        "a/../..",
        "~",
        "-rf",
        "con:",
        "a" * 300,
        "a/" * 5000,
        "$(reboot)",
        "${name}",
    ],
}
NASTY = [value for values in BAD.values() for value in values]


def composed(*overrides: str) -> dict[str, Any]:
    return plain(composing.compose([*overrides]))


def wholes() -> list[dict[str, Any]]:
    """Configurations that hold every key there is: both planners, layouts by name and written out, both kinds."""
    cem, gradient = composed("experiment=exp1"), composed("planner=gradient", "scale=smoke")
    fixed, four = composed("experiment=lookups"), composed("experiment=exp5", "world=four_properties")
    fixed |= {key: deepcopy(read("layout", "original")) for key in ("control_layout", "map_layout")}
    fixed["training_layouts"] = [deepcopy(read("layout", "original"))]
    four["control_layout"] = deepcopy(read("layout", "procedural_easy"))
    return [cem, gradient, fixed, four]


def places(value: Any, above: Place = ()) -> Iterator[Place]:
    """Every place in nested mappings and lists, containers included."""
    if above:
        yield above
    parts = value if isinstance(value, dict) else range(len(value)) if isinstance(value, list) else ()
    for part in parts:
        yield from places(value[part], (*above, part))


def replaced(values: Any, place: Place, value: Any) -> Any:
    """A copy of nested mappings and lists with another value at a place."""
    if not place:
        return value
    first, *rest = place
    changed = dict(values) if isinstance(values, dict) else list(values)
    changed[first] = replaced(values[first], tuple(rest), value)
    return changed


WHOLES = wholes()
PLACES = [(number, place) for number, values in enumerate(WHOLES) for place in places(values)]


def leaves(value: Any, above: str = "") -> Iterator[tuple[str, Any]]:
    """Every value of a checked configuration that holds no others, and its dotted key."""
    if isinstance(value, BaseModel):
        value = {key: getattr(value, key) for key in type(value).model_fields}
    if isinstance(value, Mapping):
        for key, part in value.items():
            yield f"{above}.{key}", key
            yield from leaves(part, f"{above}.{key}")
    elif isinstance(value, tuple):
        for part in value:
            yield from leaves(part, above)
    else:
        yield above, value


def check_sane(config: Config) -> None:
    """A configuration that was accepted can be run as far as its values can tell."""
    for key, value in leaves(config):
        if isinstance(value, str):
            assert value and check_line(value) == value and len(value) <= 1000, key
        elif isinstance(value, Path):
            assert value.name not in ("", "..") and "\0" not in str(value) and len(os.fsencode(value)) < 4096, key
        elif value is not None:
            assert type(value) in (bool, int, float), key
            assert math.isfinite(value) and abs(value) <= (1e18 if key.endswith("seed") else 1e12), key
            assert type(value) is bool or math.copysign(1, value) == 1 or value < 0, key
    assert all(demand.gib <= LIMIT_GIB for demand in demands(config))
    folders = config.output, config.store, config.reference
    assert not any(lies_in(one, other) for one, other in permutations(folders, 2))
    vehicle = config.vehicle
    assert vehicle.radius >= MIN_RADIUS and vehicle.top_speed >= MIN_SPEED
    assert max(2**0.5 * vehicle.thrust, vehicle.force) / vehicle.mass * vehicle.time_step_s**2 <= MAX_SPEED
    assert config.control.goal_radius < config.control_layout.shortest_way
    assert all(len(layout.circles) <= 1000 for layout in (*config.training_layouts, config.map_layout))
    for stage in stages(config):
        json.dumps(stage.config, allow_nan=False).encode()
        assert len(stage.digest) == 16


def check_told(message: str, origin: str = "the test: ") -> None:
    """One sentence a line, nothing raw in it, none of the depths in it."""
    lines = message.split("\n")
    assert 1 <= len(lines) <= 11
    for line in lines:
        assert line.startswith((origin, "... and ")), line
        assert line.isprintable() and line.endswith((".", "?")) and len(line) < 1000, line
        assert not [word for word in ("pydantic", "http", "Traceback", "Error:", "Exception") if word in line], line


def written(value: Any) -> list[str]:
    """How a message may show a value."""
    forms: list[Callable[[Any], str]] = [
        repr,
        lambda value: repr(str(value).encode("utf-8", "surrogatepass").decode("utf-8", "replace")),
        lambda value: repr(float(value) + 0.0),
        lambda value: repr(int(value)),
    ]
    found = []
    for form in forms:
        try:
            found.append(form(value))
        except (ValueError, TypeError, OverflowError):
            continue
    return [text if len(text) < 50 else text[:30] for text in found] or ["too large to be shown"]


def attempt(number: int, place: Place, value: Any) -> str:
    """Put a value at a place of a whole configuration; returns what came of it."""
    try:
        config = Config.checked(replaced(WHOLES[number], place, value), "the test")
        memory.check(config, "the test")
    except ConfigError as error:
        message = str(error)
        check_told(message)
        assert [part for part in place if isinstance(part, str)][-1] in message, message
        if not isinstance(value, (dict, list, tuple, set)):
            assert any(text in message for text in written(value)), message
        return "refused"
    check_sane(config)
    return "accepted"


def tell(attack: str, counts: Counter[str], least: int, tried: Callable[[str, int, str], None]) -> None:
    """Record how many inputs were tried."""
    tried(attack, counts.total(), "one sentence and status 2, or a sane configuration")
    print(f"{attack}: {counts['refused']} refused, {counts['accepted']} accepted.")
    assert counts.total() >= least


def examples(number: int) -> settings:
    return settings(
        max_examples=number * max(FACTOR, 1),
        derandomize=not FACTOR,
        deadline=None,
        database=None,
        suppress_health_check=list(HealthCheck),
    )


def test_every_key_with_every_bad_value(tried: Callable[[str, int, str], None]) -> None:
    """All keys of conf/ times all values of the list above: a sentence with key and value, or sane settings."""
    counts: Counter[str] = Counter()
    for number, place in PLACES:
        for value in NASTY:
            counts[attempt(number, place, value)] += 1
    tell("wrong values of every kind for every key", counts, 10_000, tried)
    assert counts["refused"] > 0.8 * counts.total()


scalars = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.integers(-5, 5),
    st.integers(0, 18).map(lambda digits: 10**digits),
    st.floats(),
    st.floats(0, 1),
    st.text(max_size=20),
    st.text(st.characters(categories=["Cc", "Cf", "Cs", "Zl", "Zp", "Co", "Cn"]), min_size=1, max_size=5),
    st.integers(1, 10**6).map(lambda length: "x" * length),
    st.floats().map(str),
    st.integers().map(str),
    st.dates(),
    st.datetimes(),
    st.sampled_from(NASTY),
)
anything = st.recursive(
    scalars,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5) | st.integers(), inner, max_size=3),
    max_leaves=6,
)


def test_any_key_with_any_value(tried: Callable[[str, int, str], None]) -> None:
    """Values drawn at random, nested ones too."""
    counts: Counter[str] = Counter()

    @examples(3000)
    @given(st.sampled_from(PLACES), anything)
    def check(chosen: tuple[int, Place], value: Any) -> None:
        counts[attempt(*chosen, value)] += 1

    check()
    tell("random values for random keys", counts, 3000, tried)


def test_several_keys_at_once_and_keys_that_do_not_exist(tried: Callable[[str, int, str], None]) -> None:
    """Two values at once, whose sizes multiply, and keys of any text."""
    counts: Counter[str] = Counter()
    sizes = st.integers(0, 6).map(lambda digits: 10**digits) | st.floats(1e-13, 1e13)

    @examples(2000)
    @given(st.integers(0, len(WHOLES) - 1), st.data())
    def check(number: int, data: st.DataObject) -> None:
        values = WHOLES[number]
        numeric = [place for place in places(values) if isinstance(_at(values, place), (int, float))]
        chosen = data.draw(st.lists(st.sampled_from(numeric), min_size=2, max_size=4))
        for place in chosen:
            values = replaced(values, place, data.draw(sizes))
        unknown = data.draw(st.none() | st.tuples(st.sampled_from(["model", "data", "planner"]), st.text(max_size=300)))
        if unknown and unknown[1] not in values[unknown[0]]:
            values = values | {unknown[0]: values[unknown[0]] | {unknown[1]: 1}}
        try:
            config = Config.checked(values, "the test")
            memory.check(config, "the test")
            check_sane(config)
            counts["accepted"] += 1
        except ConfigError as error:
            check_told(str(error))
            counts["refused"] += 1

    check()
    tell("several wrong values at once", counts, 2000, tried)


def _at(values: Any, place: Place) -> Any:
    for part in place:
        values = values[part]
    return values


@pytest.fixture
def command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[[Sequence[str], str], str]:
    """Call a command in this process with nothing that can be run; returns what it says.

    It must say it on the error stream, end with status 2, and write nothing.
    """

    def started(*_: Any) -> NoReturn:
        pytest.fail("a run was started")

    for function in ("_job", "find", "check_models"):
        monkeypatch.setattr(run, function, started)
    monkeypatch.chdir(tmp_path)

    def call(arguments: Sequence[str], entry: str = "affmap") -> str:
        monkeypatch.setattr(sys, "argv", [entry, *arguments])
        with pytest.raises(SystemExit) as leaving:
            COMMANDS[entry]()
        captured = capsys.readouterr()
        assert leaving.value.code == 2 and captured.out == "" and not list(tmp_path.iterdir()), arguments
        message = captured.err.removesuffix("\n")
        check_told(message, "")
        return message

    return call


# fmt: off
LINES: dict[str, list[str]] = {
    "neither a folder": ["a", "{", "}", "[", ")", "@", "+", "++", "'", "nope/..a", "a b"],
    "names no file of conf/": ["planner=null", "model=null", "experiment=null"],
    "cannot be read": [
        "", " ", "=", "==", "=value", "key==", "a=b=c", "@=1", "~",
        "title=[1", "title={a", "title='a", 'title="a', "title=${", "title=(", "title=a)", "title=f(x)", "title=\ud800",
        "title=\x1b[0m", "title=a\nb", "title=a\0b", "title=!!python/object/apply:os.system [id]", "title=a: b}",
        "title=" + "[" * 2000, "title=" + "[" * 2000 + "]" * 2000, "members=" + "9" * 5000, "\u202etitle=a",
        "title=${nope}", "title=${oc.env:NOPE}", "title=${title}",
        "sweep=[1]", "title=${vehicle.nope}", "model.context_size=${model.context_size}",
        "members@x=3", "~hydra", "planner=3", "store=???",
        "experiment=a\0b", "hydra=null", "hydra.mode=x",
        "hydra.launcher.n_jobs=zero", "hydra.job.chdir=maybe", "hydra.run.dir=${nope}", "hydra.sweep.subdir=${nope}",
        "seed=choice()", "seed=choice(", "seed=range()", "seed=range(a)", "seed=range(0,9,0)", "seed=interval(0,1)",
        "seed=shuffle(range(1000000000))", "seed=shuffle()", "output=~/x", "output=a;b", "title=größer",
        "seed=int(a)", "seed=tag(a,1,2)", "seed=sort(1,a)", "seed=extend_list(1)", "seed=1,,2", "seed=,",
    ],
    "leave out the +": ["+title=3"],
    "known key": [
        "key=", "key=1", "model.key=1", "planner@x=cem", "~nope", "defaults=[]", "planner={a: 1}", "sweep={a: 1.5}",
    ],
    "may be another value": [
        "seed=${now:%S}", "title=${hydra:nope}", "title=${nope:1}", "title='${now:%S}'", "title=${hydra.job.num}",
        "title=${oc.decode:'{'}",
    ],
    "of them out": ["output=a,b", "threads=1,2", "model.context_size=1,1.0"],
    "twice; give": ["model.context_size=1,1", "planner=cem,cem"],
    "in two jobs": ["seed=0,1"],
    "is a key of": [
        "experiment=exp1|planner.num_elites=3", "planner.decay=0.9", "agent=random|agent.std=1", "rival.steps=1",
    ],
    "variable of make": ["JOBS=1", "SCALE=smoke", "MODELS=reference", "ARGS="],
    "does not exist; ": [
        "planner=", "planner=oracle", "planner=../cem", "experiment=", "experiment=exp99", "experiment=../exp1",
        "scale=huge", "models=steal", "lookup=/etc/passwd", "hydra/launcher=nope",
    ],
    "jobs": [
        "seed=range(3,1)", "seed=glob(*)", "seed=range(100000)", "seed=range(1000000000)", "seed=range(0,1,0.000001)",
        "seed=range(0,1,1e-300)", "planner=glob(x*)",
    ],
    "one name at a time": ["experiment=exp1,exp2", "experiment=[exp1,exp2]", "experiment=glob(*)"],
    "not known here": ["--force", "-x", "--config-dir=/tmp", "--experimental-rerun=config.pickle", "--resolve"],
    "hydra.": [
        "hydra.launcher.n_jobs=0", "hydra.launcher.n_jobs=100000", "hydra.launcher=null", "hydra.sweep.dir=",
        "hydra.sweep.dir=..", "hydra.run.dir=..", "hydra.sweep.subdir=", "hydra.run.dir=" + "a" * 300,
        "hydra.job.chdir=true", "hydra.job.chdir=false,true", "hydra.job.chdir=true|search=cem",
    ],
    "is not": [
        "sweep=3", "sweep=null", "+sweep.seed=true", "+key=1", "++model.key=1", "growth=a b", "growth=[]",
        "model.context_size=1,x", "model.context_size=0,1,-1", "members=range(3)", "planner=cem,gradient|sweep=4",
        "title=${vehicle}", "title=", "title=null", "output=", "name=a/../b", "name=a//b", "name=..",
        "output=.", "output=/", "output='~/x'",
        "members=1e400", "members=true", "members=nan", "threads=100000", "world=procedural_hard",
    ],
    "holds: doors": ["world=moon", "control_layout=moon", "training_layouts=[fog,moon]"],
    "without folder and ending; did you mean fog": ["world=../fog", "world=fog.yaml"],
    "missing": ["planner=[]", "~model", "~title", "~planner.kind", "~vehicle.radius"],
    "folder of its own": ["output=runs/store", "store=runs/reference/store", "store=runs/../runs/single"],
    "another name": ["output=somewhere/store"],
    "lies in": ["output=runs", "output=runs/store/a", "store=runs/reference"],
    "depend on": [
        "report.compare=nope", "report.x=nope", "report.color=control.device", "report.compare=title",
        "report.compare=training.batch_sizes", "report.compare=data.seed.x", "report.compare=world",
    ],
    "growth of its own": ["growth=exp3"],
    "instead of the agent": ["rival=ppo|agent=random"],
    "GiB": [
        "members=1000000", "data.num_sequences=1000000|data.num_steps=1000", "lookup.spacing=1e-6",
        "planner.horizon=1000000|planner.num_candidates=1000", "report.map_spacing=1e-6",
        "training.num_epochs=1000000|members=1000000", "model.hidden_size=1000000|model.context_size=1000000",
    ],
}
# fmt: on


def test_command_lines_that_mean_nothing(command: Callable[..., str], tried: Callable[[str, int, str], None]) -> None:
    """A list by hand of what Hydra's grammar, groups and sweeps can be fed with, and what the sentence is about."""
    counts: Counter[str] = Counter()
    for told, lines in LINES.items():
        for line in lines:
            assert told in command(line.split("|")), line
            counts["refused"] += 1
    tell("meaningless command lines", counts, 150, tried)


def test_the_other_commands_read_the_same_command_lines(command: Callable[..., str]) -> None:
    """One line of each kind."""
    for told in ("cannot be read", "jobs", "not known here", "hydra.", "is not", "missing", "GiB"):
        for entry in ("affmap-report", "affmap-publish"):
            assert told in command(LINES[told][0].split("|"), entry)


def test_any_key_of_the_command_line_with_any_value(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tried: Callable[[str, int, str], None],
) -> None:
    """Keys of conf/, of Hydra and of nothing, with signs and values of all kinds: a sentence and status 2, or jobs."""
    monkeypatch.chdir(tmp_path)
    counts: Counter[str] = Counter()
    own = sorted({".".join(map(str, place)) for _, place in PLACES if all(isinstance(part, str) for part in place)})
    keys = st.sampled_from(own) | st.sampled_from(["experiment", "scale", "hydra.sweep.dir", "hydra/launcher", "x", ""])
    plain_values = [str(value) for value in NASTY if not (isinstance(value, int) and abs(value) > 10**4200)]
    grammar = st.text(st.sampled_from("[]{}(),:='\"\\$@~+-*. \tab01"), max_size=8)
    functions = st.sampled_from(
        ["choice", "range", "glob", "interval", "shuffle", "sort", "int", "float", "str", "json"]
    )
    values = st.one_of(
        st.sampled_from(plain_values),
        grammar,
        st.builds("{}({})".format, functions, grammar),
        st.builds("'{}'".format, st.sampled_from(plain_values)),
        st.builds("${{{}}}".format, st.sampled_from(own) | grammar),
        st.text(max_size=10),
    )

    @examples(100)
    @given(st.sampled_from(["", "", "", "+", "++", "~"]), keys, st.sampled_from(["=", "=", "=", "", "@"]), values)
    def check(sign: str, key: str, equals: str, value: str) -> None:
        accepted: list[run.Sweep] = []
        monkeypatch.setattr(sys, "argv", ["affmap", f"{sign}{key}{equals}{value}"])
        code = None
        try:
            run.command(lambda arguments: accepted.append(run.Sweep.read(arguments)))
        except SystemExit as leaving:
            code = leaving.code
        captured = capsys.readouterr()
        assert captured.out == "" and not list(tmp_path.iterdir()) and code == (None if accepted else 2)
        for asked in accepted:
            assert captured.err == "" and 0 < len(asked.configs) <= sweep.MAX_JOBS
            for config in asked.configs:
                check_sane(config)
        if not accepted:
            check_told(captured.err.removesuffix("\n"), "")
        counts["accepted" if accepted else "refused"] += 1

    check()
    tell("random command lines", counts, 100, tried)
