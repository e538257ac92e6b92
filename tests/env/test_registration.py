"""The environments under their names in Gymnasium: made, in vectors, in its wrappers, and registered without cost."""

import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium import spaces, wrappers
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env
from rollouts import actions, assert_bit_equal, rollout

from affmap.env import Layout, Procedural, Vehicle, VehicleEnv, register
from affmap.env.registration import environments
from affmap.settings import ConfigError, folder, read

NAMES = {
    "affmap/Vehicle-v0": "original",
    "affmap/Fog-v0": "fog",
    "affmap/FourProperties-v0": "four_properties",
    "affmap/Original-v0": "original",
    "affmap/ProceduralCrowdedEasy-v0": "procedural_crowded_easy",
    "affmap/ProceduralCrowdedHard-v0": "procedural_crowded_hard",
    "affmap/ProceduralEasy-v0": "procedural_easy",
    "affmap/ProceduralHard-v0": "procedural_hard",
    "affmap/ThreeLooks-v0": "three_looks",
    "affmap/TrainingFog-v0": "training_fog",
    "affmap/TrainingForceDown-v0": "training_force_down",
    "affmap/TrainingForceUp-v0": "training_force_up",
    "affmap/TrainingObstacles-v0": "training_obstacles",
    "affmap/TwelveObstacles-v0": "twelve_obstacles",
    "affmap/TwoObstacles-v0": "two_obstacles",
    "affmap/TwoObstaclesApart-v0": "two_obstacles_apart",
    "affmap/TwoObstaclesNarrow-v0": "two_obstacles_narrow",
}
"""By hand, for names are what users write down."""
MADE = ["affmap/Original-v0", "affmap/ProceduralEasy-v0"]


def run(code: str) -> str:
    """The output of a process of its own; warnings are errors."""
    command = [sys.executable, "-W", "error", "-W", "ignore:builtin type:DeprecationWarning", "-c", code]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


def test_every_layout_has_a_name() -> None:
    """The table above, and a name for each file, also of those that a user has added."""
    assert set(NAMES) <= set(environments())
    assert len(environments()) == len(list(folder().glob("layout/*.yaml"))) + 1
    own = {name: arguments["layout"] for name, arguments in environments().items() if arguments}
    assert own.items() >= {name: layout for name, layout in NAMES.items() if name != "affmap/Vehicle-v0"}.items()


# Gymnasium's checker warns of unbounded positions (fog reports any) and, without a render mode, that it cannot render.
@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize(("name", "layout"), NAMES.items())
def test_every_environment_can_be_made_and_passes_gymnasium_s_checker(name: str, layout: str) -> None:
    """Its world has the file's name, its view the file's channels, and an episode 200 steps."""
    env = gymnasium.make(name)
    env.reset(seed=0)
    assert isinstance(env.unwrapped, VehicleEnv) and env.unwrapped.layout.name == layout
    assert isinstance(env.observation_space, spaces.Dict)
    assert env.observation_space["view"].shape == (len(read("layout", layout)["channels"]), 11, 11)
    assert env.spec is not None and env.spec.max_episode_steps == 200
    check_env(env.unwrapped, skip_render_check=True)


@pytest.mark.parametrize(
    "code",
    [
        "import affmap, gymnasium",
        "import gymnasium, affmap",
        "import affmap, importlib; importlib.reload(affmap); import gymnasium",
        "import affmap, importlib.util; assert importlib.util.find_spec('gymnasium'); import gymnasium",
        "import gymnasium; gymnasium.make('affmap:affmap/Fog-v0')",
    ],
)
def test_importing_both_in_either_order_registers(code: str) -> None:
    """In a process of its own; or Gymnasium imports the package that stands before the colon."""
    actual = run(f"{code}; print(*[name for name in gymnasium.registry if name.startswith('affmap')], sep='\\n')")
    assert set(actual.split()) == set(environments())


def test_registering_reads_no_layout() -> None:
    """Files that are no YAML, or have no name that an environment could have, do no harm until they are asked for."""
    code = """
import sys, pathlib, tempfile
from affmap.settings import base
conf = pathlib.Path(tempfile.mkdtemp()); (conf / "layout").mkdir()
for name in ("broken", "not a name", "x"): (conf / "layout" / f"{name}.yaml").write_text("{")
base.folder, base.own_folder = lambda: conf, lambda: None
import gymnasium
print(*sorted(name for name in gymnasium.registry if name.startswith("affmap")))
"""
    assert run(code).split() == ["affmap/Broken-v0", "affmap/Vehicle-v0", "affmap/X-v0"]


def test_it_is_registered_once() -> None:
    """Registering again changes nothing and does not warn."""
    spec = gymnasium.registry["affmap/Vehicle-v0"]
    register()
    assert gymnasium.registry["affmap/Vehicle-v0"] is spec


def test_a_seed_draws_a_world_and_each_reset_another() -> None:
    """One environment made twice: layouts and flights are bit-equal, and layouts differ from reset to reset."""
    envs = [VehicleEnv("procedural_easy") for _ in range(2)]
    drawn: list[Layout] = []
    for seed in (3, None, None, 3, 4):
        assert_bit_equal(*(rollout(env, 20, seed) for env in envs))
        first, second = (env.layout for env in envs)
        assert first == second
        drawn.append(first)
    assert drawn[0] == drawn[3]
    assert len({layout.model_dump_json() for layout in drawn}) == 4


def test_worlds_that_are_drawn_obey_their_rules_and_are_seen_and_felt() -> None:
    """Reference: the fixed layout that was drawn, flown as such from the same place, without fog's noise."""
    rules = Procedural.load("layout", "procedural_hard")
    env = VehicleEnv(rules, render_mode="rgb_array")
    for seed in range(3):
        observation, info = env.reset(seed=seed)
        options = {"position": info["position"], "goal": env.goal}
        fixed = VehicleEnv(env.layout, render_mode="rgb_array")
        assert rules.count[0] <= len(env.layout.circles) <= rules.count[1]
        seen, _ = fixed.reset(seed=0, options=options)
        np.testing.assert_array_equal(observation["view"], seen["view"])
        np.testing.assert_array_equal(env.render(), fixed.render())
        for action in actions(30, seed):
            (mine, *_, felt), (its, *_, expected) = env.step(action), fixed.step(action)
            np.testing.assert_array_equal(mine["view"], its["view"])
            assert str(felt) == str(expected)
        np.testing.assert_array_equal(env.probe([[1.0, 1.0]]), fixed.probe([[1.0, 1.0]]))


def test_before_the_first_reset_there_is_no_world_to_look_at() -> None:
    with pytest.raises(gymnasium.error.ResetNeeded, match=r"Call reset\(\) first: it draws the layout"):
        VehicleEnv("procedural_easy").probe([[1.0, 1.0]])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"count": (60, 60)}, "no layout was found"),
        ({"start_margin": 0.05}, "too small for a vehicle of radius 0.06"),
    ],
)
def test_rules_that_give_no_usable_world_are_named(changes: dict[str, Any], message: str) -> None:
    env = VehicleEnv(Procedural.load("layout", "procedural_easy", **changes))
    with pytest.raises(ValueError, match=message):
        env.reset(seed=0)


@pytest.mark.parametrize("mode", ["sync", "async"])
@pytest.mark.parametrize("name", MADE)
def test_environments_in_a_vector_equal_each_alone(name: str, mode: str) -> None:
    """N separate runs: environment `i` of a vector gets the seed `seed + i`; in one process, and in one for each."""
    envs = gymnasium.make_vec(name, num_envs=3, vectorization_mode=mode)
    observations, _ = envs.reset(seed=11)
    actual = [({key: value.copy() for key, value in observations.items()}, np.zeros(3))]
    for action in actions(30)[:, None].repeat(3, axis=1):
        observations, rewards, *_ = envs.step(action)
        actual.append(({key: value.copy() for key, value in observations.items()}, rewards))
    envs.close()
    for number in range(3):
        alone = rollout(VehicleEnv(NAMES[name]), 30, seed=11 + number)
        for (observations, rewards), (observation, reward, *_) in zip(actual, alone, strict=True):
            assert rewards[number] == reward
            for key, value in observation.items():
                np.testing.assert_array_equal(observations[key][number], value)


@pytest.mark.parametrize("name", MADE)
def test_gymnasium_s_wrappers_do_what_they_do(name: str) -> None:
    """All at once, against the bare environment: flat observations, throttles from -1 to 1, an episode's statistics."""
    bare, env = VehicleEnv(NAMES[name]), gymnasium.make(name, max_episode_steps=20)
    env = wrappers.RescaleAction(env, np.float32(-1), np.float32(1))
    env = wrappers.RecordEpisodeStatistics(wrappers.FlattenObservation(env))
    steps = rollout(bare, 20, seed=5)
    actual = [env.reset(seed=5)[0]]
    for action in actions(20):
        observation, _, terminated, truncated, info = env.step(2 * action - 1)
        actual.append(observation)
    assert truncated and not terminated
    assert isinstance(env.observation_space, spaces.Box)
    assert env.observation_space.shape == (6 + 121 * len(bare.layout.channels),)
    for flat, (observation, *_) in zip(actual, steps, strict=True):
        np.testing.assert_allclose(flat, spaces.flatten(bare.observation_space, observation), atol=1e-6)
    assert info["episode"]["l"] == 20
    assert info["episode"]["r"] == pytest.approx(sum(reward for _, reward, *_ in steps))
    normal = wrappers.NormalizeObservation(env)
    normal.reset(seed=5)
    for action in actions(20):
        observation, *_ = normal.step(2 * action - 1)
        assert env.observation_space.shape == observation.shape and np.isfinite(observation).all()


LAYOUTS = [Layout.load("layout", "two_obstacles"), Procedural.load("layout", "procedural_easy")]


@pytest.mark.parametrize("layout", [*LAYOUTS, *(layout.plain for layout in LAYOUTS)])
def test_a_specification_with_a_layout_can_be_stored_and_made_again(
    layout: Layout | Procedural | dict[str, Any],
) -> None:
    """The flight of the first environment, from its settings and from their keys and values; in vectors, too."""
    vehicle = Vehicle.load("vehicle", "default", thrust=3.0)
    arguments: dict[str, Any] = {"layout": layout, "vehicle": vehicle, "goal_radius": 0.3}
    env = wrappers.ClipAction(gymnasium.make("affmap/Vehicle-v0", max_episode_steps=7, **arguments))
    assert env.spec is not None and isinstance(env.unwrapped, VehicleEnv)
    made = gymnasium.make(EnvSpec.from_json(env.spec.to_json()))
    assert made.spec == env.spec and env.unwrapped.vehicle == vehicle
    assert isinstance(made, wrappers.ClipAction)
    assert_bit_equal(*(rollout(one, 7, seed=3) for one in (env, made)))  # type: ignore[arg-type]
    envs = gymnasium.make_vec("affmap/Vehicle-v0", num_envs=2, **arguments)
    assert envs.spec is not None
    again = gymnasium.make_vec(EnvSpec.from_json(envs.spec.to_json()))
    assert again.spec == envs.spec and again.num_envs == 2
    for one, other in zip(envs.reset(seed=3)[0].values(), again.reset(seed=3)[0].values(), strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"layout": {**LAYOUTS[0].plain, "start_side": -1}}, "layout: start_side = -1 is not allowed: it should be"),
        ({"layout": {**LAYOUTS[1].plain, "gap": "wide"}}, "layout: gap = 'wide' is not allowed: it should be"),
        ({"layout": {}}, "layout: name is missing; add the key"),
        ({"vehicle": {"mass": -1.0}}, "^vehicle: mass = -1.0 is not allowed: it should be greater than 0"),
    ],
)
def test_mistakes_in_a_layout_s_keys_and_values_are_named(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        gymnasium.make("affmap/Vehicle-v0", **arguments)


def test_a_video_can_be_recorded(tmp_path: Path) -> None:
    """One file for the episode."""
    pytest.importorskip("moviepy")
    env = gymnasium.make("affmap/ProceduralEasy-v0", max_episode_steps=5, render_mode="rgb_array")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # moviepy's own
        video = wrappers.RecordVideo(env, str(tmp_path), episode_trigger=lambda episode: episode == 0)
        video.reset(seed=0)
        for action in actions(5):
            video.step(action)
        video.close()
    assert [path.name for path in tmp_path.glob("*.mp4")] == ["rl-video-episode-0.mp4"]
