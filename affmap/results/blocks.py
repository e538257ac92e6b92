"""Which effects of circles the blocks of context codes have taken on. Pure functions of tables of shares."""

from itertools import combinations

import pandas as pd


def together(shares: pd.DataFrame) -> pd.Series:
    """Share of the members in which the same block has the largest part in two effects, by pairs of effects.

    Members without a number, such as diverged ones, have no block in common.

    Args:
        shares: of blocks in the effects of all, columns `affmap.results.files.SHARE_COLUMNS`.
    """
    parts = shares.pivot_table("share", ["member", "effect"], "block", sort=False, dropna=False)
    largest = parts.fillna(-1.0).idxmax(axis=1).where(parts.notna().all(axis=1)).unstack(sort=False)  # [M, P]
    return pd.Series({pair: (largest[pair[0]] == largest[pair[1]]).mean() for pair in combinations(largest, 2)})
