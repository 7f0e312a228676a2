# SPDX-License-Identifier: Apache-2.0
"""Statistics of distances between a scan and a surface, each with its definition.

All functions take signed distances [m], positive outside the surface.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.spatial import cKDTree

DISC_RADIUS = 2e-3
"""Radius [m] of the disc over which a local mean is taken before a maximum is quoted."""

DISC_POINTS = 50
"""Fewest scan points in a disc whose mean may be quoted."""

LARGEST_DISC_RADIUS = 6e-3
"""A thin scan widens the disc up to this radius [m]; beyond it no local maximum is quoted."""

ALIKE = 0.5
"""Errors of a merged scan are alike over about this share of the object's radius: each view has
one of its own. In simulated scans of ten views the sigma of a pose grows with it up to here."""

QUANTILES = (0.5, 0.95)
DENSE_CELLS = 2**24
"""Boxes of at most this many cells are numbered by a table of all of them."""

CELLS_PER_RADIUS = 3
"""Points are pooled in cells of this fraction of the disc's radius before discs are formed."""


@dataclass(frozen=True)
class Summary:
    """Of |distance|: mean, rms, median, 95 % quantile, maximum; mean signed distance [m]."""

    count: int
    mean_m: float
    rms_m: float
    median_m: float
    p95_m: float
    max_m: float
    signed_mean_m: float


def summarise(distance: np.ndarray, weight: np.ndarray | None = None) -> Summary | None:
    """Summarise signed distances (n,), each counting by `weight` (n,) or all alike.

    Returns None for no distances. Weighted quantiles are those of the weighted empirical
    distribution.
    """
    if distance.size == 0:
        return None
    unsigned = np.abs(distance)
    if weight is None:
        weight = np.ones(distance.size)
        ranks = np.ceil(np.array(QUANTILES) * distance.size).astype(int) - 1
        median, p95 = np.partition(unsigned, ranks)[ranks]
    else:
        order = np.argsort(unsigned)
        share = np.cumsum(weight[order])
        ranks = np.searchsorted(share, np.array(QUANTILES) * share[-1])
        median, p95 = unsigned[order[np.minimum(ranks, distance.size - 1)]]
    total = float(weight.sum())
    if not total > 0.0:
        return None
    return Summary(
        count=int(distance.size),
        mean_m=float(weight @ unsigned / total),
        rms_m=float(np.sqrt(weight @ unsigned**2 / total)),
        median_m=float(median),
        p95_m=float(p95),
        max_m=float(unsigned.max()),
        signed_mean_m=float(weight @ distance / total),
    )


@dataclass(frozen=True)
class LocalMeans:
    """Means of the signed distance over discs of `radius_m` centred on cells of scan points.

    centre: (k, 3) [m]; mean: (k,) [m]; count: (k,) points in each disc; cell: (n,) the disc
    whose centre cell holds each scan point. Discs of fewer than DISC_POINTS points are kept here
    and not used for maxima.
    """

    radius_m: float
    centre: np.ndarray
    mean: np.ndarray
    count: np.ndarray
    cell: np.ndarray

    @property
    def quotable(self) -> np.ndarray:
        """Which discs hold enough points, (k,) bool."""
        return self.count >= DISC_POINTS

    def share(self, marked: np.ndarray) -> np.ndarray:
        """Return which share (k,) of the points of each disc's centre cell is `marked` (n,)."""
        n = len(self.mean)
        return np.bincount(self.cell, marked, minlength=n) / np.bincount(self.cell, minlength=n)

    def largest(self, discs: np.ndarray) -> float | None:
        """Return the largest |local mean| [m] of the `discs` (k,) bool; None of no disc."""
        return float(np.abs(self.mean[discs]).max()) if discs.any() else None


def local_means(points: np.ndarray, distance: np.ndarray) -> LocalMeans | None:
    """Average signed distances (n,) at `points` (n, 3) over discs of DISC_RADIUS.

    Scanner noise averages out in a disc while an error of the model does not: the largest local
    mean is a maximum one may quote. When fewer than half the discs hold DISC_POINTS points, the
    radius grows by steps of a quarter to at most LARGEST_DISC_RADIUS. Returns None for no points.
    """
    if len(points) == 0:
        return None
    radius = DISC_RADIUS
    while True:
        means = _disc_means(points, distance, radius)
        if means.quotable.mean() >= 0.5 or 1.25 * radius > LARGEST_DISC_RADIUS:
            return means
        radius *= 1.25


def _disc_means(points: np.ndarray, distance: np.ndarray, radius: float) -> LocalMeans:
    cell, n_cells = group_by_cell(points, radius / CELLS_PER_RADIUS)
    count = np.bincount(cell, minlength=n_cells)
    total = np.bincount(cell, distance, minlength=n_cells)
    centre = np.column_stack(
        [np.bincount(cell, points[:, axis], minlength=n_cells) / count for axis in range(3)]
    )
    pairs = cKDTree(centre).query_pairs(radius, output_type='ndarray')
    ones = np.ones(2 * len(pairs))
    rows = np.concatenate((pairs[:, 0], pairs[:, 1]))
    columns = np.concatenate((pairs[:, 1], pairs[:, 0]))
    near = coo_matrix((ones, (rows, columns)), shape=(n_cells, n_cells)).tocsr()
    disc_count = near @ count + count
    disc_total = near @ total + total
    return LocalMeans(radius, centre, disc_total / disc_count, disc_count.astype(np.int64), cell)


def group_by_cell(points: np.ndarray, size: float) -> tuple[np.ndarray, int]:
    """Number the cubic cells of side `size` [m] that hold points; returns (cell (n,), cells)."""
    whole = np.floor(points / size).astype(np.int64)
    whole -= whole.min(axis=0)
    shape = whole.max(axis=0) + 1
    key = (whole[:, 0] * shape[1] + whole[:, 1]) * shape[2] + whole[:, 2]
    cells = int(np.prod(shape, dtype=float))
    if cells > DENSE_CELLS:
        _, cell = np.unique(key, return_inverse=True)
        cell = cell.reshape(-1)
        return cell, int(cell.max()) + 1
    held = np.zeros(cells, bool)
    held[key] = True
    number = np.cumsum(held) - 1
    return number[key], int(number[-1]) + 1


def mean_unsigned_noise(sigma: float) -> float:
    """Return the mean |d| that normal noise of standard deviation `sigma` [m] alone produces."""
    return float(np.sqrt(2.0 / np.pi) * sigma)
