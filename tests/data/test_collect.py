"""Exploration: reproducible bit by bit, one stream a sequence, and what is recorded is what was seen."""

import inspect
import io
import math
import re
import zipfile
from itertools import combinations

import numpy as np
import pytest

from affmap.data.collect import Exploration, collect, coverage, free_position, random_actions
from affmap.env import Layout, Vehicle
from affmap.random import generator
from affmap.settings import ConfigError
from affmap.view import view

LAYOUT, VEHICLE = Layout.load("layout", "original"), Vehicle.load("vehicle", "default")
Arrays = dict[str, np.ndarray]


def exploration(**changes: object) -> Exploration:
    small: dict[str, object] = {"num_sequences": 4, "num_validation": 1, "num_steps": 30}
    return Exploration.load("data", "default", **{**small, **changes})


def fog() -> Layout:
    """Fog everywhere, in a channel of its own, and something harmless to look at."""
    things = [
        {"center": [1.5, 1.0], "radius": 2.0, "effect": "fog", "channel": "fog"},
        {"center": [1.5, 1.0], "radius": 0.5, "effect": "none", "channel": "solid"},
    ]
    return Layout.load("layout", "original", channels=["solid", "fog"], circles=things)


@pytest.fixture(scope="module")
def explored() -> Arrays:
    return collect([LAYOUT], VEHICLE, exploration())


def test_shapes_and_types(explored: Arrays) -> None:
    """Those that the function's help lists."""
    assert {key: (array.shape, array.dtype.name) for key, array in explored.items()} == {
        "position": ((4, 31, 2), "float32"),
        "true_position": ((4, 31, 2), "float32"),
        "view": ((4, 30, 1, 11, 11), "bool"),
        "action": ((4, 30, 4), "float32"),
        "touching": ((4, 30), "bool"),
    }
    assert sorted(re.findall(r"\| `(\w+)` \|", inspect.getdoc(collect) or "")) == sorted(explored)


@pytest.mark.parametrize("layout", [LAYOUT, fog()], ids=["original", "fog"])
def test_the_same_seed_gives_bit_equal_data_and_another_seed_others(layout: Layout) -> None:
    """A second collection; in fog the noise counts too."""
    first, again = (collect([layout], VEHICLE, exploration()) for _ in range(2))
    other = collect([layout], VEHICLE, exploration(seed=1))
    for key in first:
        np.testing.assert_array_equal(first[key], again[key])
    for key in ("position", "true_position", "action"):
        for sequence in range(4):
            assert (first[key][sequence] != other[key][sequence]).any(), key


def test_several_worlds_follow_each_other_each_with_its_own_views_and_walls() -> None:
    """The first world's sequences are those collected there alone; all are flown differently, in their own world."""
    empty = Layout.load("layout", "original", circles=[])
    both = collect([LAYOUT, empty], VEHICLE, exploration())
    alone = collect([LAYOUT], VEHICLE, exploration())
    for key, array in both.items():
        assert len(array) == 8
        np.testing.assert_array_equal(array[:4], alone[key], err_msg=key)
    assert len({array.tobytes() for array in both["action"]}) == 8
    for layout, part in ((LAYOUT, slice(0, 4)), (empty, slice(4, 8))):
        seen = view(layout.map, both["true_position"][part, :-1].astype(float))
        assert (seen != both["view"][part]).mean() < 1e-3  # positions are kept in float32


@pytest.mark.parametrize("layout", [LAYOUT, fog()], ids=["original", "fog"])
def test_a_sequence_does_not_depend_on_how_many_there_are(layout: Layout) -> None:
    """Reference: the same alone. Two sequences are the first two of four, and all differ."""
    four, two = (collect([layout], VEHICLE, exploration(num_sequences=number)) for number in (4, 2))
    for key in four:
        np.testing.assert_array_equal(four[key][:2], two[key])
    for key in ("position", "action"):
        assert len({array.tobytes() for array in four[key]}) == 4
    if layout is not LAYOUT:
        noise = four["position"] - four["true_position"]
        assert noise.std() == pytest.approx(1, abs=0.15)
        assert all(np.abs(one - other).max() > 1 for one, other in combinations(noise, 2))


def test_views_are_of_the_true_positions_before_each_step(explored: Arrays) -> None:
    """`affmap.view.view`; also in fog, where the reported positions are elsewhere."""
    layout = Layout.load("layout", "original")
    for world, arrays in ((layout, explored), (fog(), collect([fog()], VEHICLE, exploration(num_sequences=2)))):
        expected = view(world.map, arrays["true_position"][:, :-1].astype(float))
        different = (arrays["view"] != expected).mean()
        assert different < 1e-4  # a pixel's centre on a rim: positions are stored in single precision
        after = view(world.map, arrays["true_position"][:, 1:].astype(float))
        assert (after != expected).mean() > 0.001
    np.testing.assert_array_equal(explored["position"], explored["true_position"])


def test_views_are_without_doors_once_a_key_was_visited() -> None:
    """Of the paths, by the rule itself; some sequences open them, and not at once."""
    layout = Layout.load("layout", "training_doors")
    arrays = collect([layout], VEHICLE, exploration(num_sequences=6, num_steps=120))
    paths = arrays["true_position"][:, :-1].astype(float)
    is_open = layout.are_open(paths)
    assert 0 < is_open[:, -1].sum() < 6 and not is_open[:, 0].any()
    assert not arrays["view"][is_open][:, 1].any() and arrays["view"][~is_open][:, 1].any()
    closed = view(layout.map, paths[~is_open])
    assert (arrays["view"][~is_open] != closed).mean() < 1e-4


def test_sequences_start_at_rest_at_free_places_and_stay_in_the_arena(explored: Arrays) -> None:
    """Geometry: nothing overlaps by more than Box2D's slop; the first step is slower than thrust alone allows."""
    assert LAYOUT.is_free(explored["true_position"][:, 0].astype(float), VEHICLE.radius).all()
    assert LAYOUT.is_free(explored["true_position"].astype(float), VEHICLE.radius - 0.02).all()
    first = np.linalg.norm(np.diff(explored["true_position"], axis=1)[:, 0], axis=-1)
    assert first.max() <= math.sqrt(2) * VEHICLE.thrust / VEHICLE.mass * VEHICLE.time_step_s**2 + 1e-6


def test_touching_is_where_something_solid_is_near() -> None:
    """Geometry: within a tenth of the radius of something solid after the step when touching, else not overlapping."""
    arrays = collect([LAYOUT], VEHICLE, exploration(num_sequences=8, num_steps=60))
    after = arrays["true_position"][:, 1:].astype(float)
    assert 0.02 < arrays["touching"].mean() < 0.9
    assert not LAYOUT.is_free(after[arrays["touching"]], 1.1 * VEHICLE.radius).any()
    assert LAYOUT.is_free(after[~arrays["touching"]], 0.99 * VEHICLE.radius).all()


def test_each_finished_sequence_is_reported() -> None:
    numbers: list[int] = []
    collect([LAYOUT], VEHICLE, exploration(num_sequences=3, num_steps=1), numbers.append)
    assert numbers == [0, 1, 2]


def test_the_file_holds_no_pickles(explored: Arrays) -> None:
    """Every member of the archive is a plain NPY array, readable without pickle."""
    file = io.BytesIO()
    np.savez_compressed(file, allow_pickle=False, **explored)
    with zipfile.ZipFile(file) as archive:
        for key, array in explored.items():
            content = io.BytesIO(archive.read(f"{key}.npy"))
            np.testing.assert_array_equal(np.lib.format.read_array(content, allow_pickle=False), array)


def runs(actions: np.ndarray) -> list[int]:
    """Lengths of the stretches of equal actions."""
    changes = np.flatnonzero((actions[1:] != actions[:-1]).any(axis=1)) + 1
    return np.diff(np.concatenate([[0], changes, [len(actions)]])).tolist()


@pytest.mark.parametrize("max_hold", [1, 3, 8])
def test_actions_are_held_for_one_to_max_hold_steps(max_hold: int) -> None:
    """Statistics of 8,000 steps: lengths are uniform. Gentle actions only, of which no two are equal."""
    settings = exploration(num_steps=8000, binary_share=0.0, max_hold=max_hold)
    actions = np.array(random_actions(settings, generator(0, "test")))
    assert actions.shape == (8000, 4) and actions.dtype == np.float32
    lengths = runs(actions)[:-1]  # the last one is cut off
    counts = np.bincount(lengths, minlength=max_hold + 1)
    assert len(counts) == max_hold + 1 and counts[0] == 0
    share = counts[1:] / len(lengths)
    np.testing.assert_allclose(share, 1 / max_hold, atol=4 * math.sqrt(1 / max_hold / len(lengths)) + 1e-9)


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_a_share_of_the_actions_is_all_or_nothing(share: float) -> None:
    """Statistics of 4,000 actions: the share within four deviations, throttles fair; the others uniform in [0, 1]."""
    settings = exploration(num_steps=4000, binary_share=share, max_hold=1)
    actions = np.array(random_actions(settings, generator(0, "test")))
    assert actions.min() >= 0 and actions.max() <= 1
    binary = np.isin(actions, (0, 1)).all(axis=1)
    assert binary.mean() == pytest.approx(share, abs=4 * math.sqrt(share * (1 - share) / 4000))
    if share > 0:
        np.testing.assert_allclose(actions[binary].mean(axis=0), 0.5, atol=0.06)
        assert len(np.unique(actions[binary], axis=0)) == 16
    if share < 1:
        gentle = actions[~binary]
        assert not np.isin(gentle, (0, 1)).any()
        for throttle in gentle.T:
            np.testing.assert_allclose(np.quantile(throttle, [0.1, 0.5, 0.9]), [0.1, 0.5, 0.9], atol=0.05)


def test_an_action_lasts_exactly_as_many_steps_as_there_are() -> None:
    """A hold that is longer than the sequence is cut off."""
    assert all(len(random_actions(exploration(num_steps=n), generator(n, "test"))) == n for n in range(1, 20))


def test_free_places_are_uniform_and_free() -> None:
    """Geometry; and the quarters of a symmetric world get the same share of 400 places (fixed seeds)."""
    places = np.array([free_position(LAYOUT, VEHICLE, generator(seed, "test")) for seed in range(400)])
    assert LAYOUT.is_free(places, VEHICLE.radius).all()
    counts = np.histogram2d(places[:, 0], places[:, 1], bins=2, range=((0, 3), (0, 2)))[0]
    assert counts.min() > 65 and counts.max() < 135  # expected 100, standard deviation 8.7


def test_a_world_without_a_free_place_is_an_error() -> None:
    """One obstacle that fills the arena."""
    everywhere = {"center": [1.5, 1.0], "radius": 3.0, "effect": "obstacle", "channel": "solid"}
    full = Layout.load("layout", "original", circles=[everywhere])
    with pytest.raises(ValueError, match=r"layout 'original' has no free place for a vehicle of radius 0.06"):
        free_position(full, VEHICLE, generator(0, "test"))


def test_coverage_counts_visits_and_free_squares(explored: Arrays) -> None:
    """Brute force, square by square; a square may be wide and the last one holds its upper border."""
    rng = np.random.default_rng(0)
    positions = np.concatenate([rng.uniform(0, (3, 2), (150, 2)), [[3.0, 2.0], [0.0, 0.0], [0.75, 0.5]]])
    for places, cell in ((positions, 0.1), (positions, 0.25), (explored["true_position"], 0.1)):
        actual = coverage(LAYOUT, VEHICLE, places, cell)
        columns, rows = round(3 / cell), round(2 / cell)
        counts, free = np.zeros((rows, columns), int), np.zeros((rows, columns), bool)
        for x, y in places.reshape(-1, 2).astype(float):
            counts[min(math.floor(y / cell + 1e-9), rows - 1), min(math.floor(x / cell + 1e-9), columns - 1)] += 1
        for row in range(rows):
            for column in range(columns):
                free[row, column] = LAYOUT.is_free(np.array([(column + 0.5), (row + 0.5)]) * cell, VEHICLE.radius)
        np.testing.assert_array_equal(actual["counts"], counts)
        np.testing.assert_array_equal(actual["free"], free)
        visited = sum(1 for count, is_free in zip(counts.flat, free.flat, strict=True) if is_free and count)
        assert actual["coverage"] == pytest.approx(visited / free.sum())
        assert 0 < actual["coverage"] < 1 and not free.all()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"num_validation": 4}, r"num_validation = 4 leaves nothing to train on; .* less than num_sequences = 4"),
        ({"num_sequences": 0}, "num_sequences = 0 is not allowed"),
        ({"max_hold": 0}, "max_hold = 0 is not allowed"),
        ({"binary_share": 1.5}, "binary_share = 1.5 is not allowed"),
        ({"binary_share": math.nan}, "binary_share = nan is not allowed"),
        ({"seed": -1}, "seed = -1 is not allowed"),
        ({"start": "fog"}, "start = 'fog' is not allowed: it should be 'free' or 'clear'"),
    ],
)
def test_bad_settings_are_named(changes: dict[str, object], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        exploration(**changes)


def test_sequences_may_start_outside_fog_only() -> None:
    """All in the belt's two clear strips, by the reports, which are exact there; a world without one is an error."""
    belt = Layout.load("layout", "fog_belt")
    free, clear = (collect([belt], VEHICLE, exploration(num_sequences=20, start=start)) for start in ("free", "clear"))
    differs = [(each["position"][:, 0] != each["true_position"][:, 0]).any(-1) for each in (free, clear)]
    assert differs[0].any() and not differs[1].any()
    x = clear["true_position"][:, 0, 0]
    assert ((x < 0.5) | (x > 2.5)).all() and (x < 0.5).any() and (x > 2.5).any()
    with pytest.raises(ValueError, match="has no free place outside fog for a vehicle"):
        collect([fog()], VEHICLE, exploration(start="clear"))


def test_nothing_is_seen_in_fog_where_the_layout_says_so() -> None:
    """Views of the dark belt: empty where the report is off, and those of the other belt elsewhere."""
    lit, dark = (
        collect([Layout.load("layout", name)], VEHICLE, exploration()) for name in ("fog_belt", "fog_belt_dark")
    )
    np.testing.assert_array_equal(lit["true_position"], dark["true_position"])
    in_fog = (dark["position"] != dark["true_position"]).any(-1)[:, :-1]
    assert in_fog.any() and not in_fog.all()
    assert not dark["view"][in_fog].any() and lit["view"][in_fog].any()
    np.testing.assert_array_equal(dark["view"][~in_fog], lit["view"][~in_fog])
