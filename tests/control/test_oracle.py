"""Agents that know the physics: their paths against Box2D, their deviations by hand, halves against plain loops."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

import affmap
from affmap import compiled
from affmap.control.agent import Agent, ControlSettings, Decision, Observation
from affmap.control.episodes import bring, control
from affmap.control.oracle import HalfOracle, Oracle
from affmap.control.pilot import Pilot
from affmap.env.body import THROTTLES, Vehicle
from affmap.env.layout import Layout
from affmap.env.procedural import load
from affmap.env.vehicle import VehicleEnv
from affmap.gaussian import Gaussian
from affmap.model.lookup import AffordanceMap, ExactLookup
from affmap.model.stack import ModelSettings, Stack
from affmap.model.transition import MLP, Carry
from affmap.planning.cem import CEMPlanner
from affmap.planning.gradient import GradientPlanner
from affmap.random import generator
from affmap.settings import ConfigError, read
from affmap.view import view

VEHICLE = Vehicle.load("vehicle", "default")
KINDS = ("oracle", "seen", "filter", "true_mean", "true_deviation")
STEP_STD = 0.0005  # u, as in `conf/agent/oracle.yaml`
SETTINGS = ControlSettings.load("control", "default")
H = 6
PLANNER = CEMPlanner.load("planner", "cem", horizon=H, num_candidates=8, num_iterations=2)
HARD = load("procedural_hard")
assert not isinstance(HARD, Layout)
SEEDS, AGENTS = (4, 5), 3
B = len(SEEDS) * AGENTS
WORLDS = [HARD.draw(generator(seed, "world", run)) for seed in SEEDS for run in range(AGENTS)]
FOG = Layout.load("layout", "four_properties")  # fog of 0.3 u around (2.1, 1.4), which acts at the centre


def oracle(layouts: Sequence[Layout], **changes: Any) -> Oracle:
    return Oracle(layouts, VEHICLE, changes.pop("planner", PLANNER), SETTINGS, **changes)


def stack(*seeds: int, kind: type[MLP] = MLP) -> Stack:
    settings = ModelSettings.load("model", "default", context_size=3)
    return Stack(settings, WORLDS[0].map.num_channels, seeds, kind).requires_grad_(False)


def agent(seeds: Sequence[int], layouts: Sequence[Layout], spacing: float = 0.1) -> Agent:
    """A model-predictive agent whose map is coarse."""
    whole = stack(*seeds)
    lookup = AffordanceMap.paint(whole, [layout.map for layout in layouts], spacing)
    return Agent(whole, lookup, PLANNER, SETTINGS, WORLDS[0].channels)


def observations(layouts: Sequence[Layout] = WORLDS, seed: int = 0) -> Observation:
    """A vehicle on its way in each world."""
    rng = np.random.default_rng(seed)
    places = [rng.uniform(0, 1, (500, 2)) * layout.size for layout in layouts]
    free = [some[layout.is_free(some, VEHICLE.radius)][0] for some, layout in zip(places, layouts, strict=True)]
    position = torch.tensor(np.array(free), dtype=torch.float32)
    delta, goal = rng.uniform(-0.08, 0.08, (len(free), 2)), rng.uniform((0, 0), (3, 2), (len(free), 2))
    seen = torch.cat([view_of(layout, place) for layout, place in zip(layouts, position, strict=True)])
    return Observation(position, torch.tensor(delta, dtype=torch.float32), seen, torch.tensor(goal).float())


def view_of(layout: Layout, place: Tensor) -> Tensor:
    return view(layout.map, place[None])


def random_actions(*shape: int, seed: int = 9) -> Tensor:
    return torch.rand(*shape, H, 4, generator=torch.Generator().manual_seed(seed)).round()


@pytest.mark.parametrize(
    ("layout", "start"),
    [
        (Layout.load("layout", "original"), [1.5, 1.0]),
        (Layout.load("layout", "original"), [0.2, 0.2]),
        (FOG, [1.5, 1.0]),
        (FOG, [1.9, 0.95]),
        (WORLDS[0], [0.2, 0.2]),
    ],
)
def test_what_it_imagines_is_what_the_vehicle_then_does(layout: Layout, start: list[float]) -> None:
    """Box2D, with what the vehicle senses of itself: its reported place and the last change of it, outside fog."""
    knowing, rng, found = oracle([layout]), np.random.default_rng(1), []
    for number in range(6):
        env = VehicleEnv(layout, VEHICLE)
        env.reset(seed=number, options={"position": start})
        for _ in range(2):
            seen, *_, info = env.step(rng.uniform(size=4))
        assert not info["in_fog"]
        actions = random_actions(1, 1, seed=number)
        path = knowing.imagine(Observation.of([seen]), actions).mean[0, 0]
        flown = [env.step(action)[4] for action in actions[0, 0].numpy()]
        np.testing.assert_allclose(path, [info["position"] for info in flown], atol=2e-3)
        found.append((path[-1] - path[0]).norm() > 0.1 or any(info["touching"] for info in flown))
    assert any(found)


def test_deviations_add_up_and_fog_counts_at_both_ends() -> None:
    """By hand: outside, in fog, in fog, outside, outside; a step has its own variance and that of each end in fog."""
    path = torch.tensor([[2.1, 1.2], [2.2, 1.5], [2.1, 1.75], [2.1, 1.8]])[None, None]
    own, noise = 0.002**2, VEHICLE.fog_std**2
    steps = np.array([own + noise, own + 2 * noise, own + noise, own])
    outside = Observation(*(part[:1] for part in observations()))._replace(position=torch.tensor([[2.1, 1.0]]))
    found = oracle([FOG], step_std=0.002).true_log_std(outside, path)
    assert found.shape == path.shape
    np.testing.assert_allclose(found[0, 0].exp() ** 2, np.repeat(steps.cumsum()[:, None], 2, axis=1), rtol=1e-5)
    inside = outside._replace(position=torch.tensor([[2.1, 1.3]]))
    steps[0] += noise
    found = oracle([FOG], step_std=0.002).true_log_std(inside, path)
    np.testing.assert_allclose(found[0, 0].exp() ** 2, np.repeat(steps.cumsum()[:, None], 2, axis=1), rtol=1e-5)


@pytest.mark.parametrize(("acts", "foggy"), [("center", False), ("rim", True)])
def test_fog_counts_where_the_layout_says(acts: str, foggy: bool) -> None:
    """By hand: a vehicle of 0.06 u at 0.33 u from the centre of fog of 0.3 u."""
    layout = FOG.model_copy(update={"acts": acts})
    seen = Observation(*(part[:1] for part in observations()))._replace(position=torch.tensor([[2.1, 1.73]]))
    std = oracle([layout]).true_log_std(seen, torch.tensor([[[[2.1, 1.74]]]])).exp().flatten()
    expected = math.sqrt(STEP_STD**2 + 2 * foggy)
    np.testing.assert_allclose(std, [expected, expected], rtol=1e-5)


def test_the_next_step_is_predicted_in_closed_form() -> None:
    """The recursion of Box2D's damping, in free flight; the standard deviation is that of a step alone."""
    layout = Layout.load("layout", "original", circles=[])
    seen = observations([layout] * B)
    seen = seen._replace(position=seen.position.clamp(min=0.5, max=1.5))  # away from the borders
    action = random_actions(B)[:, 0]
    carry, step = oracle([layout]).predict(seen, action, ())
    assert carry == ()
    dt, kept = VEHICLE.time_step_s, 1 - VEHICLE.time_step_s * VEHICLE.damping
    force = VEHICLE.thrust * action.numpy() @ THROTTLES
    np.testing.assert_allclose(step.mean, (seen.delta.numpy() + dt**2 * force / VEHICLE.mass) * kept, atol=1e-5)
    np.testing.assert_allclose(step.log_std, math.log(STEP_STD), rtol=1e-5)


def test_whole_and_half_oracles_have_the_same_deviation_outside_fog() -> None:
    """Their files; what is compared is only where means and deviations come from."""
    assert {read("agent", name)["std"] for name in KINDS} == {STEP_STD}


def test_as_seen_two_fields_are_one() -> None:
    """The oracle itself, in a world without the second field; elsewhere, too. Alone, each field is known to both."""
    field = Layout.load("layout", "training_force_up").circles[0]
    both = field.model_copy(update={"center": (field.x + 0.1, field.y)})
    one, two = (FOG.model_copy(update={"circles": circles}) for circles in ((field,), (field, both)))
    place = torch.tensor([[field.x + 0.05, field.y]])
    seen = Observation(*(part[:1] for part in observations()))._replace(position=place)
    actions = random_actions(1, 1)[:, :, :2]  # in both fields all the time
    for knowing in (oracle([two], as_seen=True), oracle([one], as_seen=True).elsewhere([two])):
        torch.testing.assert_close(knowing.true_path(seen, actions), oracle([one]).true_path(seen, actions))
        assert repr(knowing).endswith("as seen)")
    apart = oracle([two]).true_path(seen, actions) - oracle([one]).true_path(seen, actions)
    assert (apart[..., 1] > 0).all()


def test_it_predicts_the_first_step_of_its_plan() -> None:
    """Its own path's first position and deviation."""
    knowing, seen = oracle(WORLDS), observations()
    decision, _ = knowing.act(seen, knowing.initial(B), [np.random.default_rng(b) for b in range(B)])
    torch.testing.assert_close(decision.path.mean[:, 0] - seen.position, decision.delta.mean, atol=1e-6, rtol=0)
    torch.testing.assert_close(decision.path.log_std[:, 0], decision.delta.log_std)


def one_half(seeds: Sequence[int], layouts: Sequence[Layout], true_mean: bool) -> HalfOracle:
    return HalfOracle(agent(seeds, layouts), layouts, VEHICLE, true_mean)


def makers() -> dict[str, Any]:
    """Kind -> how to make it of seeds and layouts."""
    return {
        "oracle": lambda seeds, layouts: oracle(layouts),
        "seen": lambda seeds, layouts: oracle(layouts, as_seen=True),
        "true_mean": lambda seeds, layouts: one_half(seeds, layouts, True),
        "true_deviation": lambda seeds, layouts: one_half(seeds, layouts, False),
    }


@pytest.mark.parametrize("kind", makers())
def test_agents_together_are_each_alone(kind: str) -> None:
    """Two steps in six worlds; each agent alone in its own, with its member, its generator and its planner's state."""

    def decide(which: slice) -> list[Decision]:
        seeds = SEEDS if which == slice(None) else (SEEDS[(which.start or 0) // AGENTS],)
        made = makers()[kind](seeds, WORLDS[which])
        numbers = range(B)[which]
        streams = [np.random.default_rng(number) for number in numbers]
        state, decisions = made.initial(len(numbers)), []
        for step in range(2):
            seen = Observation(*(part[which] for part in observations(seed=step)))
            decision, state = made.act(seen, state, streams)
            decisions.append(decision)
        return decisions

    together = decide(slice(None))
    assert ((together[1].action >= 0) & (together[1].action <= 1)).all()
    assert (together[1].action[0] - together[1].action[AGENTS]).abs().max() > 1e-3
    for b in range(B):
        for whole, part in zip(together, decide(slice(b, b + 1)), strict=True):
            torch.testing.assert_close(whole.action[b], part.action[0], atol=1e-4, rtol=0)
            for wholes, parts in ((whole.path, part.path), (whole.delta, part.delta)):
                torch.testing.assert_close(wholes.mean[b], parts.mean[0], atol=1e-4, rtol=0)
                torch.testing.assert_close(wholes.log_std[b], parts.log_std[0], atol=1e-4, rtol=0)


def test_a_true_mean_has_the_model_s_deviations_along_the_true_path() -> None:
    """A plain loop: each member alone predicts each step from the true place and change; variances add up."""
    seen, actions = observations(), random_actions(B, 2)
    found = one_half(SEEDS, WORLDS, True).imagine(seen, actions)
    torch.testing.assert_close(found.mean, oracle(WORLDS).imagine(seen, actions).mean, atol=1e-6, rtol=0)
    for b in range(B):
        one = stack(SEEDS[b // AGENTS])
        lookup = AffordanceMap.paint(one, [WORLDS[b].map], 0.1)
        for n in range(2):
            here, change, variance = seen.position[b], seen.delta[b], np.zeros(2)
            for step in range(H):
                code = lookup(here[None, None])
                _, prediction = one.transition.step()((), code, change[None, None], actions[b, n, step][None, None])
                variance += np.exp(2 * prediction.log_std[0, 0].double().numpy())
                np.testing.assert_allclose(found.log_std[b, n, step], 0.5 * np.log(variance), atol=1e-4)
                change, here = found.mean[b, n, step] - here, found.mean[b, n, step]
    learned = agent(SEEDS, WORLDS).imagine(seen, actions)
    assert (learned.mean - found.mean).abs().max() > 0.01, "the model's own way is another one"
    assert (learned.log_std - found.log_std).abs().max() > 1e-4


def test_a_true_deviation_follows_the_model_s_mean() -> None:
    """The agent's own means; deviations by hand from where the circles of fog are, which some paths meet."""
    seen, actions = observations(), random_actions(B, 2)
    fogs = {b: [circle for circle in layout.circles if circle.effect == "fog"] for b, layout in enumerate(WORLDS)}
    near = [b for b in fogs if fogs[b]]
    for b in near:  # the start is in fog, or just beside it
        first = fogs[b][0]
        seen.position[b] = torch.tensor([first.x + first.radius + (0.02 if b % 2 else -0.02), first.y])
    found = one_half(SEEDS, WORLDS, False).imagine(seen, actions)
    expected = agent(SEEDS, WORLDS).imagine(seen, actions).mean
    torch.testing.assert_close(found.mean, expected)
    foggy = []
    for b in range(B):
        for n in range(2):
            path = torch.cat([seen.position[b, None], expected[b, n]]).tolist()
            places = [any(math.dist(place, fog.center) < fog.radius for fog in fogs[b]) for place in path]
            foggy += places
            ends = np.array(places[:-1], int) + places[1:]
            variance = np.cumsum(ends * VEHICLE.fog_std**2 + STEP_STD**2)
            np.testing.assert_allclose(found.log_std[b, n, :, 0], 0.5 * np.log(variance), rtol=1e-5, atol=1e-6)
            np.testing.assert_array_equal(found.log_std[b, n, :, 0], found.log_std[b, n, :, 1])
    assert any(foggy) and not all(foggy)


@pytest.mark.parametrize("true_mean", [True, False])
def test_half_of_the_next_step_is_the_model_s_from_the_view(true_mean: bool) -> None:
    """The trained agent's own prediction, and the oracle's, each one half."""
    seen, action = observations(), random_actions(B)[:, 0]
    carry, found = one_half(SEEDS, WORLDS, true_mean).predict(seen, action, ())
    _, learned = agent(SEEDS, WORLDS).predict(seen, action, ())
    assert carry == ()
    if true_mean:
        _, true = oracle(WORLDS).predict(seen, action, ())
        torch.testing.assert_close(found.mean, true.mean, atol=1e-6, rtol=0)
        torch.testing.assert_close(found.log_std, learned.log_std)
    else:
        torch.testing.assert_close(found.mean, learned.mean)
        path = (seen.position + learned.mean)[:, None, None]
        torch.testing.assert_close(found.log_std, oracle(WORLDS).true_log_std(seen, path)[:, 0, 0])
    assert (learned.mean - oracle(WORLDS).predict(seen, action, ())[1].mean).abs().max() > 1e-3


class Counting(MLP):
    """A recurrent model that counts the steps: its logarithms of deviations."""

    def initial(self, num_sequences: int = 1) -> Carry:
        return (torch.zeros(len(self.output_weight), num_sequences, 2),)

    def step(self) -> Any:
        def step(carry: Carry, code: Tensor, delta: Tensor, action: Tensor) -> tuple[Carry, Gaussian]:
            count = carry[0] + 1
            return (count,), Gaussian(torch.zeros_like(count), count)

        return step


def test_a_recurrent_half_remembers_what_was_executed() -> None:
    """Counted by hand: step k + j of a flight has the deviation exp(k + j) after k executed steps."""
    whole = stack(*SEEDS, kind=Counting)
    learned = Agent(whole, ExactLookup(whole, [layout.map for layout in WORLDS]), PLANNER, SETTINGS)
    half, seen = HalfOracle(learned, WORLDS, VEHICLE, True), observations()
    state = half.initial(B)
    for executed in range(3):
        decision, state = half.act(seen, state, [np.random.default_rng(b) for b in range(B)])
        variances = np.exp(2.0 * (executed + np.arange(1, H + 1))).cumsum()
        np.testing.assert_allclose(decision.path.log_std[0, :, 0], 0.5 * np.log(variances), rtol=1e-5)
        np.testing.assert_allclose(decision.delta.log_std, executed + 1)
    actions = random_actions(B, 1)
    np.testing.assert_allclose(half.imagine(seen, actions).log_std[:, 0, 0], 1.0)  # without a carry, a flight begins


def test_it_reaches_the_goal_from_every_corner_of_the_original_world() -> None:
    """Within 60 steps, where the direct way takes at least 13; and where it is was expected a step before."""
    layout = Layout.load("layout", "original")
    settings = SETTINGS.model_copy(update={"num_steps": 60})
    planner = CEMPlanner.load("planner", "cem")
    runs = control(Oracle([layout], VEHICLE, planner, settings), [layout], VEHICLE, settings, [0])
    assert runs.table["reached"].all() and (runs.table["steps_to_reach"] >= 13).all()
    assert runs.table["run"].tolist() == [0, 1, 2, 3]
    expected, position = (runs.trajectories[key] for key in ("planned_position", "position"))
    assert np.median(np.linalg.norm(expected[:, :, 0] - position[:, 1:], axis=-1)) < 1e-5


def test_elsewhere_it_knows_the_other_world() -> None:
    """Against an oracle that was made there; in one world and in one for each."""
    seen, actions = observations(), random_actions(B, 2)
    empty = Layout.load("layout", "four_properties", circles=[])
    for layouts in ([empty], WORLDS):
        found = oracle([FOG], step_std=0.1).elsewhere(layouts)
        assert type(found) is Oracle
        for mine, its in zip(
            found.imagine(seen, actions), oracle(layouts, step_std=0.1).imagine(seen, actions), strict=True
        ):
            torch.testing.assert_close(mine, its, rtol=0, atol=0)


@pytest.mark.parametrize("true_mean", [True, False])
def test_elsewhere_a_half_oracle_looks_up_there_and_knows_it(true_mean: bool) -> None:
    """Against one that was made there, with the same models."""
    seen, actions = observations(), random_actions(B, 2)
    found = one_half(SEEDS, [FOG], true_mean).elsewhere(WORLDS)
    expected = one_half(SEEDS, WORLDS, true_mean)
    assert type(found) is HalfOracle and found.true_mean is true_mean
    for mine, its in zip(found.imagine(seen, actions), expected.imagine(seen, actions), strict=True):
        torch.testing.assert_close(mine, its)


@pytest.mark.parametrize("kind", makers())
def test_it_is_brought_into_the_world_that_it_flies_in(kind: str) -> None:
    """The same as made there; a pilot brings it, too, and what it has in mind is what then happens."""
    made = makers()[kind]((4,), [Layout.load("layout", "four_properties", circles=[])])
    brought = bring(made, FOG)
    assert isinstance(brought, Oracle) and type(brought) is type(made)
    seen, actions = observations([FOG]), random_actions(1, 2)
    for mine, its in zip(
        brought.imagine(seen, actions), makers()[kind]((4,), [FOG]).imagine(seen, actions), strict=True
    ):
        torch.testing.assert_close(mine, its)
    pilot, env = Pilot(made, FOG, seed=3), VehicleEnv(FOG)
    observation, _ = env.reset(seed=0, options={"position": [0.3, 0.5], "goal": [1.6, 0.3]})
    for _ in range(5):
        action = pilot(observation)
        thought = pilot.thought
        observation, *_, info = env.step(action)
        assert thought.path.shape == (H, 2) and thought.candidates.shape[1:] == (H, 2)
        if kind != "true_deviation":
            np.testing.assert_allclose(thought.path[0], info["position"], atol=1e-4)


def test_all_the_package_s_own_ways_to_fly_take_it() -> None:
    """`affmap.fly` in a world by name; the runs of member 0."""
    settings = SETTINGS.model_copy(update={"num_steps": 3})
    runs = affmap.fly(Oracle([FOG], VEHICLE, PLANNER, settings), "two_obstacles")
    assert runs.table["member"].tolist() == [0] * 4 and runs.trajectories["action"].shape == (4, 3, 4)
    assert np.isfinite(runs.table["prediction_error"]).all()


def test_a_half_oracle_is_not_brought_where_it_cannot_see() -> None:
    """The agent's own sentence; a whole oracle sees nothing, and goes anywhere."""
    other = Layout.load("layout", "original")
    with pytest.raises(ConfigError, match=r"layout 'original' has channels .* a model sees the same ones everywhere"):
        bring(one_half((4,), [FOG], True), other)
    assert isinstance(bring(oracle([FOG]), other), Oracle)


@pytest.mark.parametrize("kind", makers())
def test_a_planner_that_follows_gradients_is_refused(kind: str) -> None:
    """One sentence with the remedy."""
    made = makers()[kind](SEEDS, WORLDS)
    made.planner = GradientPlanner.load("planner", "gradient", horizon=H, num_iterations=2)
    sentence = "the true physics has no gradients; take a planner that needs none, such as planner=cem."
    with pytest.raises(ConfigError) as caught:
        made.act(observations(), made.initial(B), [np.random.default_rng() for _ in range(B)])
    assert str(caught.value) == sentence


@pytest.mark.parametrize("kind", makers())
def test_without_numba_it_says_what_it_needs(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """As if it were not installed; where compiled loops are only switched off, there is no other twin to fly with."""
    with compiled.switched(False):
        assert isinstance(makers()[kind]((4,), [FOG]), Oracle)
    monkeypatch.setattr(compiled, "installed", lambda: False)
    with pytest.raises(ConfigError) as caught:
        makers()[kind]((4,), [FOG])
    assert str(caught.value) == "an oracle needs numba, which is not installed."


def test_a_half_oracle_flies_the_runs_of_its_members() -> None:
    """`affmap.fly`: starts and seeds are those of the agent itself."""
    settings = SETTINGS.model_copy(update={"num_steps": 2})
    half = one_half((3, 7), [FOG], True)
    half.settings = settings
    half.agent.settings = settings
    assert affmap.fly(half, FOG).table["member"].tolist() == [3] * 4 + [7] * 4


def test_an_oracle_says_which_of_its_arguments_is_wrong() -> None:
    """Worlds that are none, or neither one nor one for each vehicle; a deviation without a logarithm."""
    with pytest.raises(ConfigError, match="layouts is empty"):
        oracle([])
    for std in (0.0, -1.0, math.nan):
        with pytest.raises(ConfigError, match=r"step_std = (0\.0|-1\.0|nan) should be above 0"):
            oracle([FOG], step_std=std)
    made = oracle(WORLDS[:4])
    with pytest.raises(ConfigError, match=f"knows 4 worlds, but plans for {B} vehicles"):
        made.act(observations(), made.initial(B), [np.random.default_rng() for _ in range(B)])
