"""Named generators: golden values, and independence of order, name, key and seed."""

from itertools import combinations

import numpy as np
import pytest

from affmap.random import generator, integer, sequence

GOLDEN = [
    ((0, "planner"), 580805174, [978876653, 456506317], 0.10628865967223244),
    ((0, "exploration", 3), 4220614537, [2726725545, 3737506508], 0.8702060460659826),
    ((7, "member", 1, 2), 962315964, [3912122998, 819980970], 0.19091669724110094),
]


@pytest.mark.parametrize(("key", "number", "integers", "uniform"), GOLDEN)
def test_golden_values(key: tuple, number: int, integers: list[int], uniform: float) -> None:
    """Stored in 2026-11: published results depend on these streams never changing."""
    assert integer(*key) == number
    assert generator(*key).integers(0, 2**32, 2).tolist() == integers
    assert generator(*key).random() == uniform


def test_a_stream_does_not_depend_on_what_was_drawn_before() -> None:
    """Same alone: asked for first, or after others were made and drawn from."""
    alone = generator(5, "planner", 1).random(8)
    for name in ("world", "planner", "member"):
        generator(5, name).random(100)
    np.random.default_rng().random()
    np.testing.assert_array_equal(generator(5, "planner", 1).random(8), alone)


def test_drawing_touches_no_global_state() -> None:
    """NumPy's legacy global state is the same before and after."""
    before = np.random.get_state(legacy=False)
    generator(0, "a").random(3)
    integer(0, "a")
    after = np.random.get_state(legacy=False)
    assert before["state"]["pos"] == after["state"]["pos"]
    np.testing.assert_array_equal(before["state"]["key"], after["state"]["key"])


def test_seeds_names_and_keys_each_give_a_stream_of_their_own() -> None:
    """No two of 300 streams share one of their first four numbers of 64 bits, also where keys are nested or swapped."""
    keys = [
        (seed, name, *key)
        for seed in range(5)
        for name in ("planner", "member", "world", "batch order", "a", "")
        for key in ((), (0,), (1,), (2,), (0, 0), (0, 1), (1, 0), (1, 2), (2, 1), (100,))
    ]
    draws = [set(sequence(*key).generate_state(4, np.uint64).tolist()) for key in keys]
    assert not any(first & second for first, second in combinations(draws, 2))


def test_an_integer_fits_in_32_bits() -> None:
    """What torch and hyperopt accept as a seed, for 1000 keys."""
    numbers = [integer(0, "x", key) for key in range(1000)]
    assert all(type(number) is int and 0 <= number < 2**32 for number in numbers)
    assert max(numbers) > 2**31


def test_a_negative_seed_is_refused() -> None:
    with pytest.raises(ValueError, match="non-negative"):
        generator(-1, "planner")
