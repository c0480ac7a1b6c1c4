# SPDX-License-Identifier: Apache-2.0
"""A way around what is in between: two trees of postures that grow towards one another.

RRT-Connect (Kuffner and LaValle, 2000), its way then shortened where the straight one is free.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from calib_model.arrays import Array

STRIDE = 0.4  # m that anything moves at most from node to node
TRIALS = 400
Free = Callable[[Array, Array], bool]


class _Tree:
    """Postures (N, n), each with the one it was reached from."""

    def __init__(self, root: Array, reach: Array) -> None:
        self.nodes = [root]
        self._reach = reach
        self._parents = [0]

    def grow(self, goal: Array, free: Free) -> tuple[int, bool]:
        """One stride from the nearest node towards `goal`: that node, and whether it got on."""
        far = np.abs(np.array(self.nodes) - goal) @ self._reach
        near = int(np.argmin(far))
        share = min(1.0, STRIDE / max(float(far[near]), 1e-12))
        here = self.nodes[near]
        posture = goal if share == 1.0 else here + share * (goal - here)
        if not free(here, posture):
            return near, False
        self.nodes.append(posture)
        self._parents.append(near)
        return len(self.nodes) - 1, True

    def back(self, node: int) -> list[Array]:
        """From a node to the root."""
        found = [self.nodes[node]]
        while node:
            node = self._parents[node]
            found.append(self.nodes[node])
        return found


def rrt_connect(
    start: Array, goal: Array, free: Free, sample: Callable[[], Array], reach: Array
) -> Array | None:
    """Postures (K, n) between two postures (n,) by which the arm gets from one to the other.

    `free` judges a straight way, `sample` gives postures anywhere, `reach` (n,) says how far (m)
    a joint's turn of 1 rad moves anything. None when none was found in so many trials.
    """
    one, other = _Tree(start, reach), _Tree(goal, reach)
    for trial in range(TRIALS):
        node, grown = one.grow(sample(), free)
        if grown:
            met = _connected(other, one.nodes[node], free)
            if met is not None:
                way = one.back(node)[::-1] + other.back(met)[1:]
                way = way if trial % 2 == 0 else way[::-1]
                return np.array(shortened(way, free)[1:-1]).reshape(-1, len(start))
        one, other = other, one
    return None


def _connected(tree: _Tree, goal: Array, free: Free) -> int | None:
    """The tree's node at `goal` (n,) when it grows as far."""
    while True:
        node, grown = tree.grow(goal, free)
        if not grown:
            return None
        if np.array_equal(tree.nodes[node], goal):
            return node


def shortened(way: list[Array], free: Free) -> list[Array]:
    """A way of postures (n,) cut short: from each on to the farthest that is free straight."""
    kept, at = [way[0]], 0
    while at < len(way) - 1:
        ahead = range(len(way) - 1, at + 1, -1)
        at = next((far for far in ahead if free(way[at], way[far])), at + 1)
        kept.append(way[at])
    return kept
