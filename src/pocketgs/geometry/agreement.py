"""Groups of views whose matches agree with their poses.

Wrong poses often come in consistent groups: all views of the far side of an object that looks the same from both sides,
or a part of a room that was joined to the rest by an object that stands there twice. So views are merged into groups,
pairs with most matches first, as long as the matches between two groups fit their poses.
"""

from __future__ import annotations

import numpy as np

PAIR_FIT = 0.8
"""Share of a pair's matches that fit the poses from which on the whole pair supports them.

Of matches that one motion explains, nearly all fit correct poses. Of random matches about half lie near epipolar lines,
since these are long.
"""

MIN_SUPPORT = 1 / 3
"""Minimum share of the matches between two groups that must support the poses.

Not higher, since repeated patterns give wrong matches that agree on a motion, even between correct views. Not lower,
since wrong views find partners by chance: of a room with half the poses wrong, three agree with the largest group in
0.31 of their matches. Two correct photographs of a kitchen, with few matches in all, have no more, and are left out.
"""


def agreeing_groups(total: np.ndarray, supporting: np.ndarray) -> np.ndarray:
    """(F,) the group of each view: the number of one of its views.

    Args:
        total: (F, F) symmetric number of matches of each pair.
        supporting: (F, F) how many of these support the poses.
    """
    group = np.arange(len(total))
    pairs = np.argwhere(np.triu(supporting))
    for first, second in pairs[np.argsort(-supporting[tuple(pairs.T)], kind="stable")]:
        if group[first] == group[second]:
            continue
        one, other = group == group[first], group == group[second]
        if supporting[np.ix_(one, other)].sum() >= MIN_SUPPORT * total[np.ix_(one, other)].sum():
            group[other] = group[first]
    return group
