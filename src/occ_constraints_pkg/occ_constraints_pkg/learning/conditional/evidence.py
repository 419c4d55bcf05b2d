# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""How improbable it is that a corner is so empty by chance.

Evidence is minus the logarithm of that chance. It is counted over whole clusters (episodes, or
recordings where several episodes share one), for the samples within one are no independent
witnesses.
"""

from __future__ import annotations

import math

import numpy as np


def visit_evidence(counts: np.ndarray, shares: np.ndarray, seen: float) -> float:
    """Return the evidence of the time spent in a corner, as if visits were Poisson events.

    The expected time per cluster has a mean and a variance. As many independent visits as have the
    same ratio of the two are expected; to see a share of them is improbable as Poisson has it.

    Args:
        counts: (copies, clusters) expected rows in the corner.
        shares: (clusters,) share of the rows of each cluster.
        seen: rows seen in the corner.
    """
    totals = counts.sum(axis=1, keepdims=True)
    mean = float(totals.mean())
    if mean <= 0:
        return 0.0
    variance = float(((counts - totals * shares) ** 2).sum()) / len(counts)
    visits = mean * mean / max(variance, mean)
    ratio = seen / mean
    if ratio >= 1:
        return 0.0
    visits *= 1 - ratio + (ratio * math.log(ratio) if ratio > 0 else 0.0)
    return of_few(visits, counts.shape[1])


def of_few(visits: float, clusters: int) -> float:
    """Return what so many visits prove: a variance over few clusters is uncertain itself.

    So Student's tail takes the place of the Gaussian one.
    """
    return min(clusters / 2 * math.log1p(2 * visits / clusters), most_evidence(clusters))


def most_evidence(clusters: int) -> float:
    """Return the most that clusters prove: all were sure to come in, and none did.

    However long they are, a few of them may have a habit in common.
    """
    return clusters * math.log(clusters + 1)


def cluster_evidence(counts: np.ndarray, came: float) -> float:
    """Return the evidence of how many clusters ever come into a corner: a binomial tail's bound.

    Args:
        counts: (copies, clusters) expected rows in the corner.
        came: share of the clusters that were seen in it.
    """
    clusters = counts.shape[1]
    chance = float((counts > 0).mean()) * clusters / (clusters + 1)
    if came >= chance:
        return 0.0
    divergence = (1 - came) * math.log((1 - came) / (1 - chance))
    if came > 0:
        divergence += came * math.log(came / chance)
    return clusters * divergence


def needed_evidence(looks: float, delta: float) -> float:
    """Return the evidence that a rule needs.

    Args:
        looks: corners looked at that are as good as independent.
        delta: chance that any of them becomes a rule for nothing.
    """
    return math.log(max(looks, 1.0) / delta)
