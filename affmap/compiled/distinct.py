"""Distinct rows of pixels, found by a hash table of their bits in compiled code."""

import numpy as np

from affmap.compiled.jit import compiled, inlined

FACTOR = np.uint64(0x9E3779B97F4A7C15)  # Fibonacci hashing: 2 ** 64 / golden ratio


@inlined
def _differ(words: np.ndarray, one: int, other: int) -> bool:
    """Whether two rows differ."""
    differ = False
    for word in range(words.shape[1]):
        differ |= words[one, word] != words[other, word]
    return differ


@compiled
def number_rows(pixels: np.ndarray, table: np.ndarray, words: np.ndarray, first: np.ndarray, ids: np.ndarray) -> None:
    """Number the distinct rows of `pixels` `[n, k]` bool in order of their appearance.

    Args:
        pixels: the rows.
        table: a power of two of integers, more than n, all -1; to be used once.
        words: `[n, k / 64, rounded up]` uint64, to work with.
        first: `[n]`, gets the row where each number appears first.
        ids: `[n]`, gets the number of each row.
    """
    num_rows, num_pixels = pixels.shape
    mask = np.uint64(len(table) - 1)
    count = 0
    for row in range(num_rows):
        digest = np.uint64(0)
        for word in range(words.shape[1]):  # the next number's words are these, if it is a new one
            bits = np.uint64(0)
            for pixel in range(64 * word, min(64 * word + 64, num_pixels)):
                bits |= np.uint64(pixels[row, pixel]) << np.uint64(pixel - 64 * word)
            words[count, word] = bits
            digest = (digest ^ bits) * FACTOR
            digest ^= digest >> np.uint64(32)
        place = digest & mask
        while table[place] >= 0 and _differ(words, table[place], count):
            place = place + np.uint64(1) & mask
        if table[place] < 0:
            table[place] = count
            first[count] = row
            count += 1
        ids[row] = table[place]
