# SPDX-License-Identifier: Apache-2.0
"""A second solver for one problem: a sphere between two pins, by axisymmetric shell theory.

It shares nothing with the surfaces, assembly and solvers of this package. The meridian of a
quadrant, (r, z) over the arc s from the pole, is a cubic Hermite spline; the strains of the
rotationally symmetric shell are

    E_11 = (r'^2 + z'^2 - 1) / 2,      E_22 = ((r / r_0)^2 - 1) / 2,
    b_11 = (z'' r' - r'' z') / l,      b_22 = r z' / (l r_0^2),      l^2 = r'^2 + z'^2,

and the potential energy is minimised by Newton's method. Derivatives of the energy density come
from complex steps (exact gradient) and differences of them (tangent).

A wall that relaxes carries S(t) = g(t) S_e(0) + integral of g(t - s) dS_e(s), summed at every time
over all of its past by quadrature: no terms, no recursion.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from shell_deform.theory.gas import Gas

Array = NDArray[np.float64]

MEASURES = ('koiter', 'paper_restored', 'paper')
PIN_ELEMENTS, ELEMENTS = 4, 36
R_DOFS, Z_DOFS = [0, 1, 4, 5], [2, 3, 6, 7]
COMPLEX_STEP, TANGENT_STEP = 1e-30, 1e-6
ITERATIONS, TOLERANCE = 30, 1e-9
GAUSS_POINTS = 32


class AxisymmetricError(RuntimeError):
    """A load that this solver cannot reach."""


@dataclass(frozen=True)
class PinnedSphere:
    """A sphere of middle radius R [m] under equal and opposite pins on its axis.

    `measure`: 'koiter', 'paper' (the paper's curvature terms as printed) or 'paper_restored'.
    """

    radius: float
    thickness: float
    young: float
    poisson: float
    pin_radius: float
    measure: str = 'koiter'
    gas: Gas = field(default_factory=Gas)


@dataclass(frozen=True)
class _Quadrant:
    """Hermite elements over the arc, with their values at Gauss points.

    dofs (e, 8): r, r', z, z' at both ends. shape (e, g, 3, 4): value, first and second derivative
    of the four cubic functions. arc, weight (e, g). rest: all dofs of the sphere itself.
    """

    dofs: NDArray[np.int64]
    shape: Array
    arc: Array
    weight: Array
    under_pin: NDArray[np.bool_]
    fixed: NDArray[np.int64]
    rest: Array


def pole_displacements(sphere: PinnedSphere, forces: Array) -> Array:
    """(n,) inward displacement of each pole [m] under rising forces (n,) [N].

    It counts from where the gas alone puts the pole. Raises AxisymmetricError when no equilibrium
    is found.
    """
    solver = _Solver(sphere)
    position = solver.blown()
    start = solver.pole(position)
    last, found = 0.0, []
    for force in np.asarray(forces, dtype=float):
        position = solver.raised(position, last, force)
        last = force
        found.append(start - solver.pole(position))
    return np.array(found)


def forces_at(sphere: PinnedSphere, displacements: Array) -> Array:
    """(n,) force of each pin [N] at rising pole displacements (n,) [m] from the blown shape."""
    return np.array([force for _, _, force in _dented(sphere, displacements)])


def held_forces(
    sphere: PinnedSphere, law: Callable[[Array], Array], times: Array, displacements: Array
) -> Array:
    """(n,) force of each pin [N] at rising times (n,) [s] while its pole is at displacements [m].

    From one to the next it moves evenly; the first is a step at time 0. `law`: g. Of the wall
    alone, measure 'koiter'.
    """
    solver, forces = _HeldSolver(sphere, law), []
    position, force = solver.blown(), 0.0
    start, last = solver.pole(position), 0.0
    for time, wanted in zip(times.tolist(), displacements.tolist(), strict=True):
        solver.begin(time)
        parts = max(1, int(np.ceil(abs(wanted - last) / (0.4 * sphere.thickness))))
        for depth in np.linspace(last, wanted, parts + 1)[1:]:
            position, force = solver.dented(position, force, start - depth)
        solver.pass_by(position)
        last = wanted
        forces.append(force)
    return np.array(forces)


def outer_meridians(sphere: PinnedSphere, displacements: Array) -> list[Array]:
    """Outer face (p, 2) [m] as (radius, height), pole to equator, at rising displacements [m]."""
    half, found = 0.5 * sphere.thickness, []
    for solver, position, _ in _dented(sphere, displacements):
        r, dr, z, dz = solver.meridian(position)
        length = np.hypot(dr, dz)
        found.append(np.stack([r - half * dz / length, z + half * dr / length], axis=1))
    return found


def _dented(sphere: PinnedSphere, displacements: Array) -> Iterator[tuple[_Solver, Array, float]]:
    """Solver, shape and force [N] at rising pole displacements [m] from the blown shape."""
    solver = _Solver(sphere)
    position = solver.blown()
    start, force, last = solver.pole(position), 0.0, 0.0
    for wanted in np.asarray(displacements, dtype=float):
        steps = max(1, int(np.ceil((wanted - last) / (0.4 * sphere.thickness))))
        for depth in np.linspace(last, wanted, steps + 1)[1:]:
            position, force = solver.dented(position, force, start - depth)
        last = wanted
        yield solver, position, force


class _Solver:
    """Newton's method on the quadrant; forces are those of a whole pin."""

    def __init__(self, sphere: PinnedSphere) -> None:
        if sphere.measure not in MEASURES:
            raise AxisymmetricError(f'measure is {sphere.measure!r}; choose one of {MEASURES}')
        self.sphere = sphere
        self.mesh = _quadrant(sphere)
        size = int(self.mesh.dofs.max()) + 1
        self._free = np.setdiff1d(np.arange(size), self.mesh.fixed)
        self._pole = 2
        self._load = self._pin_load()
        self._rest_volume = self._volume(self.mesh.rest)[0]

    def pole(self, position: Array) -> float:
        """Height of the pole [m]."""
        return float(position[self._pole])

    def meridian(self, position: Array) -> Array:
        """(4, p) r, r', z, z' of the middle surface at the Gauss points, pole to equator."""
        r, dr, _, z, dz, _ = self._at(position)
        return np.stack([r.ravel(), dr.ravel(), z.ravel(), dz.ravel()])

    def blown(self) -> Array:
        """The shape that the gas alone gives."""
        return self._solved(self.mesh.rest, 0.0, None)[0]

    def raised(self, position: Array, last: float, force: float) -> Array:
        """From the equilibrium under `last` to that under `force` [N], halving steps as needed."""
        share, step = 0.0, 1.0
        while share < 1.0:
            step = min(step, 1.0 - share)
            try:
                trial = last + (share + step) * (force - last)
                position = self._solved(position, trial, None)[0]
            except AxisymmetricError:
                step *= 0.5
                if step < 1e-4:
                    raise
                continue
            share += step
        return position

    def dented(self, position: Array, force: float, height: float) -> tuple[Array, float]:
        """The equilibrium with the pole at `height` [m] and the force [N] that holds it there."""
        return self._solved(position, force, height)

    def _solved(self, start: Array, force: float, height: float | None) -> tuple[Array, float]:
        free, position = self._free, start.copy()
        pole = int(np.flatnonzero(free == self._pole)[0])
        scale = self.sphere.young * self.sphere.thickness**2
        for _ in range(ITERATIONS):
            gradient, stiffness = self._energy(position)
            residual = (gradient - force * self._load)[free]
            missing = 0.0 if height is None else height - position[self._pole]
            done = np.linalg.norm(residual) < TOLERANCE * scale
            if done and abs(missing) < 1e-12:
                return position, force
            columns = np.column_stack([-residual, self._load[free]])
            step, by_force = np.linalg.solve(stiffness[np.ix_(free, free)], columns).T
            if height is not None:
                change = (missing - step[pole]) / by_force[pole]
                step, force = step + change * by_force, force + change
            if not np.all(np.isfinite(step)):
                break
            largest = float(np.abs(step[free % 2 == 0]).max())
            position[free] += min(1.0, self.sphere.thickness / max(largest, 1e-300)) * step
        raise AxisymmetricError(
            f'axisymmetric sphere: no equilibrium under {force:.4g} N ({self.sphere})'
        )

    def _energy(self, position: Array) -> tuple[Array, Array]:
        """Gradient (N,) and second derivative (N, N) of strain and gas energy."""
        gradient, stiffness = self._sum(position, self._strain_energy())
        if self.sphere.gas.is_sealed:
            volume, row, bend = self._volume(position)
            ratio = volume / self._rest_volume
            pressure = self.sphere.gas.pressure(ratio)
            slope = self.sphere.gas.pressure_slope(ratio) / self._rest_volume
            gradient = gradient - pressure * row
            stiffness = stiffness - pressure * bend - slope * np.outer(row, row)
        return gradient, stiffness

    def _strain_energy(self) -> Callable[[Array], Array]:
        """Of a ring per arc length."""
        return _strain_energy(self.sphere, self.mesh.arc)

    def _volume(self, position: Array) -> tuple[float, Array, Array]:
        """Volume of the upper half [m^3] and its first two derivatives."""

        def density(q: Array) -> Array:
            return -np.pi * q[0] ** 2 * q[4]

        value = float(np.sum(self.mesh.weight * density(self._at(position)).real))
        return (value, *self._sum(position, density))

    def _at(self, position: Array) -> Array:
        """(6, e, g) r, r', r'', z, z', z'' at the Gauss points."""
        local = position[self.mesh.dofs]
        r = np.einsum('egda,ea->deg', self.mesh.shape, local[:, R_DOFS])
        z = np.einsum('egda,ea->deg', self.mesh.shape, local[:, Z_DOFS])
        return np.concatenate([r, z])

    def _sum(self, position: Array, density: Callable[[Array], Array]) -> tuple[Array, Array]:
        """Gradient and second derivative of the integral of a density over the quadrant."""
        q = self._at(position)
        size = np.array([1e-2, 1.0, 1e2] * 2)

        def slopes(at: Array) -> Array:
            found = []
            for i in range(6):
                moved = at.astype(complex)
                moved[i] += 1j * COMPLEX_STEP
                found.append(density(moved).imag / COMPLEX_STEP)
            return np.stack(found)

        first = slopes(q)
        second = np.empty((6, 6, *first.shape[1:]))
        for j in range(6):
            step = np.zeros((6, 1, 1))
            step[j] = TANGENT_STEP * size[j]
            second[j] = (slopes(q + step) - slopes(q - step)) / (2.0 * step[j])
        second = 0.5 * (second + np.swapaxes(second, 0, 1))
        shape = np.zeros((*self.mesh.shape.shape[:2], 6, 8))
        shape[:, :, :3, R_DOFS] = self.mesh.shape
        shape[:, :, 3:, Z_DOFS] = self.mesh.shape
        weight, dofs = self.mesh.weight, self.mesh.dofs
        count = len(position)
        gradient, stiffness = np.zeros(count), np.zeros((count, count))
        np.add.at(gradient, dofs, np.einsum('ieg,egia,eg->ea', first, shape, weight))
        tangent = np.moveaxis(second, (0, 1), (2, 3)) * weight[:, :, None, None]
        blocks = np.sum(np.swapaxes(shape, 2, 3) @ tangent @ shape, axis=1)
        np.add.at(stiffness, (dofs[:, :, None], dofs[:, None, :]), blocks)
        return gradient, stiffness

    def _pin_load(self) -> Array:
        """(N,) nodal forces of 1 N downwards, even over the arc under the pin."""
        sphere, mesh = self.sphere, self.mesh
        ring = 2.0 * np.pi * sphere.radius * np.sin(mesh.arc / sphere.radius) * mesh.weight
        ring = np.where(mesh.under_pin[:, None], ring, 0.0)
        load = np.zeros(int(mesh.dofs.max()) + 1)
        share = np.einsum('eg,ega->ea', ring / ring.sum(), mesh.shape[:, :, 0])
        np.add.at(load, mesh.dofs[:, Z_DOFS], -share)
        return load


class _HeldSolver(_Solver):
    """The same while the wall relaxes: all of its past strains are kept."""

    def __init__(self, sphere: PinnedSphere, law: Callable[[Array], Array]) -> None:
        super().__init__(sphere)
        self._law, self._now = law, 0.0
        self._times: list[float] = []
        self._strains: list[Array] = []
        self._share, self._past = 1.0, np.zeros((4, *self.mesh.arc.shape))

    def begin(self, time: float) -> None:
        """Solve for this time [s] from now on."""
        if not self._times:
            self._share = float(self._law(np.array(0.0)))
        else:
            ends = np.array([*self._times, time])
            # Nodes crowd at the end of each interval: g falls steeply from where it begins.
            x, weight = np.polynomial.legendre.leggauss(GAUSS_POINTS)
            x = 0.5 * (x + 1.0)
            lags = time - ends[1:, None] + np.diff(ends)[:, None] * x**3
            mean = self._law(lags) @ (1.5 * weight * x**2)
            strains = np.array(self._strains)
            past = float(self._law(np.array(time))) * strains[0] - mean[-1] * strains[-1]
            self._past = past + np.tensordot(mean[:-1], np.diff(strains, axis=0), axes=1)
            self._share = float(mean[-1])
        self._now = time

    def pass_by(self, position: Array) -> None:
        """The wall has come here."""
        self._times.append(self._now)
        self._strains.append(np.stack(_strains(self.sphere, self.mesh.arc, self._at(position))))

    def _strain_energy(self) -> Callable[[Array], Array]:
        sphere, arc = self.sphere, self.mesh.arc
        stretching, bending = _stiffness(sphere)
        (along, around, bend, bend_around), nu = self._past, sphere.poisson
        forces = stretching * np.stack([along + nu * around, around + nu * along])
        moments = bending * np.stack([bend + nu * bend_around, bend_around + nu * bend])
        elastic = _strain_energy(sphere, arc)
        ring = 2.0 * np.pi * sphere.radius * np.sin(arc / sphere.radius)

        def density(q: Array) -> Array:
            one, two, three, four = _strains(sphere, arc, q)
            held = forces[0] * one + forces[1] * two + moments[0] * three + moments[1] * four
            return self._share * elastic(q) + ring * held

        return density


def _stiffness(sphere: PinnedSphere) -> tuple[float, float]:
    """Of the wall against stretching [N/m] and bending [N m]."""
    stretching = sphere.young * sphere.thickness / (1.0 - sphere.poisson**2)
    return stretching, stretching * sphere.thickness**2 / 12.0


def _strains(sphere: PinnedSphere, arc: Array, q: Array) -> tuple[Array, Array, Array, Array]:
    """Stretch along the meridian and around, change of curvature likewise, by koiter."""
    r, dr, ddr, _, dz, ddz = q
    r_0 = sphere.radius * np.sin(arc / sphere.radius)
    squared = dr**2 + dz**2
    length = np.sqrt(squared)
    bend, bend_around = (ddz * dr - ddr * dz) / length, r * dz / (length * r_0**2)
    stretch = 0.5 * (squared - 1.0), 0.5 * ((r / r_0) ** 2 - 1.0)
    return (*stretch, bend + 1.0 / sphere.radius, bend_around + 1.0 / sphere.radius)


def _strain_energy(sphere: PinnedSphere, arc: Array) -> Callable[[Array], Array]:
    """Energy per arc length [J/m] of a ring as a function of r, r', r'', z, z', z''."""
    radius, nu = sphere.radius, sphere.poisson
    stretching, bending = _stiffness(sphere)
    r_0 = radius * np.sin(arc / radius)
    r_1, z_1 = np.cos(arc / radius), -np.sin(arc / radius)

    def density(q: Array) -> Array:
        r, dr, ddr, _, dz, ddz = q
        squared = dr**2 + dz**2
        length = np.sqrt(squared)
        along, around = 0.5 * (squared - 1.0), 0.5 * ((r / r_0) ** 2 - 1.0)
        bend_along, bend_around = (ddz * dr - ddr * dz) / length, r * dz / (length * r_0**2)
        if sphere.measure != 'koiter':
            area = length * r / r_0
            bend_along, bend_around = area * bend_along, area * bend_around
        bend_along, bend_around = bend_along + 1.0 / radius, bend_around + 1.0 / radius
        if sphere.measure == 'paper':
            bend_along = bend_along + (dr * r_1 + dz * z_1 - 1.0) / radius
            bend_around = bend_around + (r / r_0 - 1.0) / radius
        stretch = along**2 + around**2 + 2.0 * nu * along * around
        bend = bend_along**2 + bend_around**2 + 2.0 * nu * bend_along * bend_around
        return np.pi * r_0 * (stretching * stretch + bending * bend)

    return density


def _quadrant(sphere: PinnedSphere) -> _Quadrant:
    """Elements of even length under the pin and, a little longer towards the equator, beyond."""
    end = 0.5 * np.pi * sphere.radius
    t = np.linspace(0.0, 1.0, ELEMENTS + 1)
    beyond = sphere.pin_radius + (end - sphere.pin_radius) * (0.4 * t + 0.6 * t**2)
    nodes = np.concatenate([np.linspace(0.0, sphere.pin_radius, PIN_ELEMENTS + 1), beyond[1:]])
    length = np.diff(nodes)[:, None]
    gauss, weight = np.polynomial.legendre.leggauss(5)
    x = 0.5 * (gauss + 1.0)
    value = [1 - 3 * x**2 + 2 * x**3, x - 2 * x**2 + x**3, 3 * x**2 - 2 * x**3, x**3 - x**2]
    first = [6 * x**2 - 6 * x, 1 - 4 * x + 3 * x**2, 6 * x - 6 * x**2, 3 * x**2 - 2 * x]
    second = [12 * x - 6, 6 * x - 4, 6 - 12 * x, 6 * x - 2]
    # (e, g, 3, 4): per arc length, and slopes of the nodes are per arc length too
    per_length = np.stack([length**0, length**-1, length**-2], axis=2)
    per_dof = np.stack([length**0, length, length**0, length], axis=2)
    shape = np.stack([np.stack(part, axis=1) for part in (value, first, second)], axis=1)
    angle = nodes / sphere.radius
    rest = np.stack(
        [
            sphere.radius * np.sin(angle),
            np.cos(angle),
            sphere.radius * np.cos(angle),
            -np.sin(angle),
        ],
        axis=1,
    )
    elements = len(nodes) - 1
    last = 4 * elements
    return _Quadrant(
        dofs=4 * np.arange(elements)[:, None] + np.arange(8),
        shape=shape * per_length[:, :, :, None] * per_dof[:, :, None, :],
        arc=nodes[:-1, None] + length * x,
        weight=0.5 * length * weight,
        under_pin=np.arange(elements) < PIN_ELEMENTS,
        # on the axis r = z' = 0, on the equator z = r' = 0
        fixed=np.array([0, 3, last + 1, last + 2]),
        rest=rest.reshape(-1),
    )
