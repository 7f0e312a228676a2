# SPDX-License-Identifier: Apache-2.0
"""The dent itself: where it is, its measured profile, and its depth under the hidden pin.

The largest displacement sits where the pin touches, and the pin hides it from the scanner. It is
therefore extrapolated from the ring that is seen around the pin, by the exact solution of a
pressed elastic plate (`pressed_plate`), and labelled so. No shell theory enters.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from scan_compare.deformed_surface import DeformedSurface
from scan_compare.pressed_plate import PressedPin, bed_of, pressed_pin
from scan_compare.rigid import IDENTITY, Pose, rigid_fit
from scan_compare.robust import spread_of, tukey

PROFILE_RADIUS = 12e-3
"""The profile reaches this far [m] from the contact's axis."""

FIT_RADIUS = 6e-3
"""The apex is extrapolated from points within this distance [m] of the axis."""

FOOT_REACH = 1e-3
"""Points so far [m] beyond FIT_RADIUS are looked at, too: some of their feet lie within it."""

RING_WIDTH = 0.5e-3
"""Width [m] of the rings over which the profile is averaged."""

SEEN_RADIUS = 1e-3
SEEN_POINTS = 20
"""With this many scan points within SEEN_RADIUS of the axis the apex counts as seen."""

EXTRAPOLATION_SHARE = 0.09
"""Of what the depth rises from the hidden radius to the axis, this share is the standard deviation
of the extrapolation: the plate is linear. Root mean square over solids that no recording shows
(solids of `tests/benchmarks/dent_depth.py`)."""

CENTRE_SIGMA = 0.5e-3
"""How far [m] a pin stands beside the contact that the hand tells: its mounting, and a turn of the
object that its undeformed region does not show."""

CENTRE_ROUNDS = 3
"""Rounds in which the pin is found beside its contact, and the points' feet on the dent."""

SLOPE_STEP = 0.02e-3
"""Step [m] of the differences that give the slope of a dent."""

BODY_ROUNDS = 10
"""Rounds of weighing in which the undeformed region settles on what moves as one body."""

UNKNOWN_PIN = 0.5
"""A pin of unknown radius is taken as this share of the radius it hides, within a factor of 2."""


@dataclass(frozen=True)
class Contacts:
    """Contact points (c, 3) on the outer face at rest and inward unit normals (c, 3).

    radius: of the pins (c,) [m], or None where nobody knows them.
    """

    point: np.ndarray
    inward: np.ndarray
    radius: np.ndarray | None = None


@dataclass(frozen=True)
class DentProfile:
    """Measured depth around one contact.

    radius (k,), depth (k,), count (k,): ring means along the contact's inward normal [m]; model
    (k,): the model's depth in the same rings, NaN where it has none. apex_m, apex_sigma_m: the
    depth at the axis and its standard deviation, which holds the scatter of the points, the pose
    and the merged views of both scans and the extrapolation; extrapolation_sigma_m: that part of
    it which is alike in every scan of one dent, so that no number of them averages it out;
    extrapolated: True if the pin hid the
    axis up to hidden_radius_m; deepest_seen_m: the deepest ring mean that was seen, a lower bound.
    reference: what depth is counted from; method: how the apex was found. bent_apex_m: the
    apex of a shell that only bends, for fits of thin-shell theory, which knows no sheared wall
    and no squeezed material.
    """

    contact: np.ndarray
    radius: np.ndarray
    depth: np.ndarray
    count: np.ndarray
    model: np.ndarray
    apex_m: float
    apex_sigma_m: float
    extrapolation_sigma_m: float
    extrapolated: bool
    hidden_radius_m: float
    deepest_seen_m: float
    reference: str
    method: str
    bent_apex_m: float


def contacts_of(surface: DeformedSurface) -> Contacts:
    """Find the contacts of a model: the deepest point of each separate dent, on the rest face."""
    rest = surface.at_rest()
    samples = surface.samples
    deep = np.flatnonzero(samples.displacement > 0.5 * surface.max_displacement)
    if not np.isfinite(surface.dent_threshold):
        deep = deep[:0]
    if deep.size == 0:
        return Contacts(np.empty((0, 3)), np.empty((0, 3)))
    at_rest = rest.evaluate(samples.triangle[deep], samples.parameters[deep])
    count, label = _parts(at_rest.position, 3.0 * float(np.sqrt(samples.area[deep].max())))
    points, inward = [], []
    for dent in range(count):
        members = np.flatnonzero(label == dent)
        height = samples.displacement[deep[members]]
        if height.max() < 0.7 * surface.max_displacement:
            continue
        # the centre of the deepest part: a single sample would sit beside it
        weight = np.maximum(0.0, height - 0.9 * height.max())
        centre = weight @ at_rest.position[members] / weight.sum()
        normal = weight @ at_rest.normal[members]
        foot = rest.limit.closest_point(rest.deformed, centre[None], rest.offset)
        points.append(foot.position[0])
        inward.append(-normal / np.linalg.norm(normal))
    order = np.lexsort(np.round(np.array(points), 5).T)
    return Contacts(np.array(points)[order], np.array(inward)[order])


def _parts(points: np.ndarray, link: float) -> tuple[int, np.ndarray]:
    """Return how many parts points (n, 3) make that are linked up to `link` [m], and each one's.

    One point of every small cell stands for it: graded meshes have thousands within a link.
    """
    cells = np.floor(points / (0.25 * link)).astype(np.int64)
    _, first, of_cell = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    pairs = cKDTree(points[first]).query_pairs(link, output_type='ndarray')
    graph = coo_matrix((np.ones(len(pairs)), pairs.T), (len(first), len(first)))
    count, label = connected_components(graph, directed=False)
    return int(count), label[of_cell.reshape(-1)]


def body_motion(surface: DeformedSurface) -> Pose:
    """Return the rigid motion that the undeformed region makes from rest to the deformed shape.

    A free body may drift as a whole while it is squeezed; a dent is deep against its own body.
    Only that region says so, however little of the surface it is: what lies at the foot of a wide
    dent moves alike, too, and round by round more of it would be taken for the body.
    """
    rest = surface.at_rest().samples.position
    moved = surface.samples.position
    undeformed = surface.samples.area * (surface.samples.displacement <= surface.dent_threshold)
    if not undeformed.any():
        return IDENTITY
    weight = undeformed
    for _ in range(BODY_ROUNDS):
        pose = rigid_fit(rest, moved, weight)
        left = np.linalg.norm(moved - pose.apply(rest), axis=1)
        weight = undeformed * tukey(left, spread_of(left[weight > 0.0], 1e-9))
    return pose


def profiles(
    scan_points: np.ndarray,
    surface: DeformedSurface,
    contacts: Contacts,
    undeformed_points: np.ndarray | None,
    place_sigma: Callable[[np.ndarray, np.ndarray], float] = lambda _point, _direction: 0.0,
) -> list[DentProfile]:
    """Measure the dent around each contact; contacts without enough points are left out.

    scan_points (n, 3), undeformed_points (m, 3) or None: registered, in the object's frame [m].
    Depth is counted along the contact's inward normal from the undeformed scan, or from the model
    at rest without one, as it lies on the undeformed region of the deformed shape. place_sigma:
    standard deviation [m] that poses and merged views give a point (3,) along a direction (3,).
    """
    back = body_motion(surface).inverse()
    scan_points = back.apply(scan_points)
    model_points = back.apply(surface.samples.position)
    rest_points = surface.at_rest().samples.position
    reference = 'undeformed scan' if undeformed_points is not None else 'model at rest'
    radius = contacts.radius
    if radius is None:
        radius = np.full(len(contacts.point), np.nan)
    results = []
    for point, inward, pin in zip(contacts.point, contacts.inward, radius, strict=True):
        local = _Axis(point, inward)
        height = _reference_height(
            local, rest_points if undeformed_points is None else undeformed_points
        )
        if height is None:
            continue
        sigma = place_sigma(point, local.inward)
        wall = Wall(surface.thickness, float(pin), sigma, _curvature(height))
        profile = _profile(local, height, scan_points, model_points, wall, reference)
        if profile is not None:
            results.append(profile)
    return results


@dataclass(frozen=True)
class Wall:
    """Thickness [m], pin radius [m] (NaN unknown), sigma [m] of where the wall is seen, curvature.

    curvature (2, 2) [1/m]: of the undeformed outer face, in the directions across the axis.
    """

    thickness: float
    pin_radius: float
    place_sigma: float
    curvature: np.ndarray


class _Axis:
    """Cylindrical coordinates about a contact's axis; depth counts inward."""

    def __init__(self, point: np.ndarray, inward: np.ndarray) -> None:
        self.point = point
        self.inward = inward / np.linalg.norm(inward)
        helper = np.eye(3)[int(np.argmin(np.abs(self.inward)))]
        first = np.cross(self.inward, helper)
        first /= np.linalg.norm(first)
        self.across = np.stack((first, np.cross(self.inward, first)))

    def near(self, points: np.ndarray, radius: float, reach: float) -> tuple[np.ndarray, ...]:
        """Return across (k, 2) and depth (k,) of the points near this end of the axis."""
        depth = points @ self.inward - self.point @ self.inward
        level = np.flatnonzero(np.abs(depth) < reach)
        across = (points[level] - self.point) @ self.across.T
        inside = np.sum(across**2, axis=1) < radius**2
        return across[inside], depth[level[inside]]


def _reference_height(axis: _Axis, points: np.ndarray) -> np.ndarray | None:
    """Fit the undeformed face around the contact by a quartic in two variables."""
    across, depth = axis.near(points, PROFILE_RADIUS, PROFILE_RADIUS)
    if len(depth) < 60:
        return None
    return np.linalg.lstsq(_monomials(across), depth, rcond=None)[0]


def _monomials(across: np.ndarray) -> np.ndarray:
    x, y = (across / PROFILE_RADIUS).T
    return np.column_stack([x**i * y**j for i in range(5) for j in range(5 - i)])


def _curvature(height: np.ndarray) -> np.ndarray:
    """Second derivatives (2, 2) [1/m] at the axis of a face given by its `_monomials`."""
    square = np.array([[2.0 * height[9], height[6]], [height[6], 2.0 * height[2]]])
    return square / PROFILE_RADIUS**2


def _profile(
    axis: _Axis,
    height: np.ndarray,
    points: np.ndarray,
    model_points: np.ndarray,
    wall: Wall,
    reference: str,
) -> DentProfile | None:
    across, depth = axis.near(points, PROFILE_RADIUS, 2.0 * PROFILE_RADIUS)
    depth = depth - _monomials(across) @ height
    radius = np.hypot(*across.T)
    if np.count_nonzero(radius < FIT_RADIUS) < 30:
        return None
    near = radius < FIT_RADIUS + FOOT_REACH
    seen = np.count_nonzero(radius < SEEN_RADIUS) >= SEEN_POINTS
    hidden = 0.0 if seen else float(np.quantile(radius, min(1.0, 20 / len(radius))))
    bent = _bent_apex(across[near], depth[near], hidden)
    apex = bent
    if not seen and wall.thickness > 0.0:
        apex = _hidden_apex(across[near], depth[near], hidden, wall)
    rings, counts, means = _rings(radius, depth)
    model_across, model_depth = axis.near(model_points, PROFILE_RADIUS, 2.0 * PROFILE_RADIUS)
    model_depth = model_depth - _monomials(model_across) @ height
    model_rings = _rings(np.hypot(*model_across.T), model_depth)[2]
    full = counts >= 3
    return DentProfile(
        contact=axis.point,
        radius=rings[full],
        depth=means[full],
        count=counts[full],
        model=model_rings[full],
        apex_m=apex.depth,
        apex_sigma_m=float(np.sqrt(apex.scatter**2 + apex.model**2 + wall.place_sigma**2)),
        extrapolation_sigma_m=apex.model,
        extrapolated=not seen,
        hidden_radius_m=hidden,
        deepest_seen_m=float(means[full].max()) if full.any() else apex.depth,
        reference=reference,
        method=apex.method,
        bent_apex_m=bent.depth,
    )


def _rings(radius: np.ndarray, depth: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return ring centres, counts and mean depths (NaN for empty rings)."""
    n = round(PROFILE_RADIUS / RING_WIDTH)
    ring = np.minimum((radius / RING_WIDTH).astype(int), n - 1)
    count = np.bincount(ring, minlength=n)
    total = np.bincount(ring, depth, minlength=n)
    mean = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    return (np.arange(n) + 0.5) * RING_WIDTH, count, mean


@dataclass(frozen=True)
class _Apex:
    """Depth at the axis [m], what scatter and extrapolation add to its sigma [m], its rise, how.

    rise: in the hidden part [m].
    """

    depth: float
    scatter: float
    model: float
    rise: float
    method: str


@dataclass(frozen=True)
class _Feet:
    """Where points lie on a dent: across (n, 2), depth (n,) [m], weight (n,) of their residuals.

    A scan errs across the face, not along the axis: on a slope a point that lies outside the face
    has also moved towards the axis. Chosen by where they are seen, points at the rim of the fit
    would all be too shallow on the one side and missing on the other.
    """

    across: np.ndarray
    depth: np.ndarray
    weight: np.ndarray

    @property
    def inside(self) -> np.ndarray:
        """Which of them (n,) the fit takes."""
        inside: np.ndarray = np.hypot(*self.across.T) < FIT_RADIUS
        return inside


def _feet(
    across: np.ndarray, depth: np.ndarray, residual: np.ndarray, gradient: np.ndarray
) -> _Feet:
    """Return the feet of points on a dent that has this gradient (n, 2) there."""
    steep = 1.0 + np.sum(gradient**2, axis=1)
    sideways = (residual / steep)[:, None] * gradient
    return _Feet(
        across + sideways, depth + np.sum(sideways * gradient, axis=1), 1.0 / np.sqrt(steep)
    )


def _bent_apex(across: np.ndarray, depth: np.ndarray, hidden: float) -> _Apex:
    """Follow Kirchhoff's plate to the axis: w0 + a r^2 + b r^2 ln r.

    Timoshenko and Woinowsky-Krieger, Theory of Plates and Shells, section 19. Right where points
    near the axis are seen; without them it is what a shell that only bends would show.
    """

    def terms(at: np.ndarray) -> np.ndarray:
        scaled = np.maximum(at / FIT_RADIUS, 1e-6)
        return np.column_stack((np.ones_like(scaled), scaled**2, scaled**2 * np.log(scaled)))

    feet = _Feet(across, depth, np.ones(len(depth)))
    for _ in range(CENTRE_ROUNDS):
        inside, radius = feet.inside, np.hypot(*feet.across.T)
        solution, covariance = _trimmed_fit(
            terms(radius[inside]), feet.depth[inside], feet.weight[inside]
        )
        slope = (terms(radius + SLOPE_STEP) - terms(radius - SLOPE_STEP)) @ solution
        outward = feet.across / np.maximum(radius, 1e-6)[:, None]
        gradient = (slope / (2.0 * SLOPE_STEP))[:, None] * outward
        feet = _feet(across, depth, feet.depth - terms(radius) @ solution, gradient)
    apex, ring = terms(np.array([0.0, hidden])) @ solution
    scatter = float(np.sqrt(covariance[0, 0]))
    return _Apex(float(apex), scatter, 0.0, abs(float(apex - ring)), 'seen')


def _hidden_apex(across: np.ndarray, depth: np.ndarray, hidden: float, wall: Wall) -> _Apex:
    """Extrapolate under the pin by the pressed plate: level, tilt, curvature and the force.

    A wall thinner than its pin is wide is not squeezed to speak of and bends as under a point:
    solids of a can and a cup say so to 0.3 % of the depth, as flat pins they would be 2.5 % off.
    """
    known = np.isfinite(wall.pin_radius)
    pin = wall.pin_radius if known else UNKNOWN_PIN * hidden
    if pin > wall.thickness:
        bent = _bent_apex(across, depth, max(hidden, 2.0 * pin))
        return replace(
            bent,
            model=EXTRAPOLATION_SHARE * bent.rise,
            method='extrapolated from the ring by a bent plate',
        )
    apex, variance, rise = under_pin(across, depth, hidden, wall, pin)
    model = EXTRAPOLATION_SHARE * rise
    if not known:
        ends = [under_pin(across, depth, hidden, wall, f * pin)[0] for f in (0.5, 2.0)]
        model = float(np.hypot(model, 0.5 * (ends[0] - ends[1])))
    radius_text = f'pin radius {"" if known else "taken as "}{1e3 * pin:.2f} mm'
    return _Apex(
        apex,
        float(np.sqrt(variance)),
        model,
        rise,
        f'extrapolated from the ring by the pressed elastic plate, {radius_text}',
    )


def under_pin(
    across: np.ndarray, depth: np.ndarray, hidden: float, wall: Wall, pin_radius: float
) -> tuple[float, float, float]:
    """Return the depth at the axis [m], its variance [m^2] and its rise in the hidden part [m].

    across (n, 2), depth (n,): points around the pin [m], of which those are fitted whose feet on
    the dent lie within FIT_RADIUS. The pin may stand beside the axis: off its centre a dent is
    less deep, so a wrong axis would always tell too little. The rise counts from `hidden` [m], or
    from two pin radii where more is seen.
    """
    h = wall.thickness
    pin: PressedPin = pressed_pin(round(pin_radius / h, 6))
    bed = bed_of(h * wall.curvature)

    def fields(radius: np.ndarray) -> np.ndarray:
        return pin.fields(np.maximum(radius, pin_radius) / h, bed)

    centre, feet = np.zeros(2), _Feet(across, depth, np.ones(len(depth)))
    for _ in range(CENTRE_ROUNDS):
        inside, aside = feet.inside, feet.across - centre
        radius = np.hypot(*aside.T)
        outward = aside / np.maximum(radius, 1e-6)[:, None]
        terms = np.column_stack((fields(radius), aside / h))
        taken = feet.depth[inside], feet.weight[inside]
        level = _trimmed_fit(terms[inside], *taken)[0][:3]
        # How the depth changes as the pin moves sideways.
        rise = (fields(radius + SLOPE_STEP) - fields(radius - SLOPE_STEP)) / (2.0 * SLOPE_STEP)
        terms = np.column_stack((terms, -(rise @ level)[:, None] * outward))
        solution, covariance = _trimmed_fit(terms[inside], *taken, (-centre, CENTRE_SIGMA))
        centre = np.clip(centre + solution[-2:], -2.0 * CENTRE_SIGMA, 2.0 * CENTRE_SIGMA)
        gradient = (rise @ solution[:3])[:, None] * outward + solution[3:5] / h
        feet = _feet(across, depth, feet.depth - terms @ solution, gradient)
    at_axis = np.concatenate((pin.depth, np.zeros(4)))
    apex = float(at_axis @ solution)
    ring = float(fields(np.array([max(hidden, 2.0 * pin_radius)]))[0] @ solution[:3])
    return apex, float(at_axis @ covariance @ at_axis), abs(apex - ring)


def _trimmed_fit(
    terms: np.ndarray,
    depth: np.ndarray,
    weight: np.ndarray,
    last: tuple[np.ndarray, float] | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Return coefficients (k,) and covariance (k, k); points of a scanned pin are trimmed.

    weight (n,): of the residuals. last: what is known of the last coefficients before, and its
    standard deviation.
    """
    known, sigma = (np.zeros(0), 1.0) if last is None else last
    prior = np.eye(terms.shape[1])[terms.shape[1] - len(known) :]
    terms, depth = weight[:, None] * terms, weight * depth
    keep, rows, noise = np.ones(len(depth), bool), terms, 0.0
    for _ in range(3):
        # The prior weighs against the scatter of single points.
        rows = np.concatenate((terms[keep], noise / sigma * prior))
        target = np.concatenate((depth[keep], noise / sigma * known))
        solution = np.linalg.lstsq(rows, target, rcond=None)[0]
        residual = depth - terms @ solution
        spread = 1.4826 * float(np.median(np.abs(residual[keep])))
        keep = np.abs(residual) <= 4.0 * max(spread, 1e-9)
        noise = float(np.sqrt(np.mean(residual[keep] ** 2)))
    return solution, noise**2 * np.linalg.pinv(rows.T @ rows)
