# SPDX-License-Identifier: Apache-2.0
"""Shells whose wall relaxes: steps, ramps, holds, creep, loops, against closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from shell_deform.assemble import plain
from shell_deform.assemble.held import HeldWall, elastic_stress
from shell_deform.building import build_model, object_contacts
from shell_deform.objects import load_object
from shell_deform.objects.shell_object import ShellObject, Sphere
from shell_deform.solve.equilibrium import LoadCaseError, displaced, forced
from shell_deform.solve.first_touch import alone, first_touch
from shell_deform.solve.hold import TimedSolver, hold_times
from shell_deform.solve.newton import EquilibriumSolver
from shell_deform.solve.step_system import NewtonOptions
from shell_deform.theory.relaxation import RelaxationError, log_law, prony
from shell_deform.verification.axisymmetric import PinnedSphere, held_forces

LAW = log_law(0.05, 0.1, 1000.0)
NONLINEAR = ('koiter', 'paper', 'paper_restored', 'thick')
PIN = 0.002


class Grasp:
    """A small tennis ball between two pins."""

    def __init__(self, theory, gas='none'):
        ball = load_object('tennis_ball')
        ball = replace(ball, gas=replace(ball.gas, kind=gas))
        model = build_model(ball, theory, 250, refine_radius=PIN)
        self.contacts = object_contacts(ball, model, PIN)
        self.solver = EquilibriumSolver(model, NewtonOptions(tolerance=1e-11))
        self.start, self.touch = first_touch(self.solver, self.contacts)

    def at(self, depth):
        return displaced(self.contacts, self.touch + depth)

    def under(self, force):
        return forced(self.contacts, [force, force])

    def timed(self):
        return TimedSolver(self.solver, LAW, self.at(0.0), self.start)


@pytest.fixture(scope='module', params=NONLINEAR)
def grasp(request):
    return Grasp(request.param)


@pytest.fixture(scope='module')
def koiter():
    return Grasp('koiter')


def test_force_of_a_step_that_is_held_falls_as_the_law_says(grasp):
    """To 1e-8 in every theory: at constant travel the shape stays and every stress falls alike."""
    elastic = grasp.solver.solve(grasp.at(0.004), grasp.start).force
    timed = grasp.timed()
    first = timed.to(grasp.at(0.004), 0.0)
    np.testing.assert_allclose(first.force, float(LAW(0.0)) * elastic, rtol=1e-8)
    now = 0.0
    for time in (0.1, 3.0, 60.0, 1000.0):
        held = timed.to(grasp.at(0.004), time - now)
        now = time
        np.testing.assert_allclose(held.force, float(LAW(time)) * elastic, rtol=1e-8)


def _held_wall(grasp, depth=0.004):
    """A wall in the middle of a hold, and a state near its equilibrium."""
    state = grasp.solver.solve(grasp.at(depth), grasp.start)
    model = grasp.solver.model
    past = -0.2 * elastic_stress(model.shell, model.theory, state.unknowns)
    return HeldWall(model.shell, model.theory, 0.9, past), state.unknowns


def test_the_stiffness_of_a_held_wall_is_the_derivative_of_its_force(grasp):
    wall, unknowns = _held_wall(grasp)
    matrix = wall.shell.pattern.matrix(wall._held(unknowns, stiff=True)[2])
    rng = np.random.default_rng(3)
    direction = rng.normal(size=unknowns.shape)
    direction[len(grasp.solver.model.rest) :] *= 0.1
    direction.reshape(-1)[wall.shell.idle_dofs] = 0.0
    step = 1e-7
    ahead, behind = (wall._held(unknowns + s * direction, False)[1] for s in (step, -step))
    slope = (ahead - behind).reshape(-1) / (2.0 * step)
    assert np.linalg.norm(matrix @ direction.reshape(-1) - slope) < 1e-5 * np.linalg.norm(slope)


def test_the_force_of_a_held_wall_is_the_derivative_of_its_potential(grasp):
    wall, unknowns = _held_wall(grasp)
    direction = np.random.default_rng(4).normal(size=unknowns.shape)
    direction.reshape(-1)[wall.shell.idle_dofs] = 0.0
    step = 1e-7
    ahead, behind = (wall._held(unknowns + s * direction, False)[0] for s in (step, -step))
    force = wall._held(unknowns, False)[1]
    assert (ahead - behind) / (2.0 * step) == pytest.approx(float(np.sum(force * direction)), 1e-5)


def test_compiled_and_plain_held_walls_agree(koiter):
    for theory in ('koiter', 'paper', 'paper_restored'):
        model = koiter.solver.model
        rng = np.random.default_rng(5)
        positions = model.rest + 1e-4 * rng.normal(size=model.rest.shape)
        past = rng.normal(size=6 * len(model.shell.weights))
        fast = HeldWall(model.shell, theory, 1.0, past)._held(positions, True)
        slow = plain.held_tangent(model.shell, theory, past.reshape(-1, 6), positions, True)
        assert fast[0] == pytest.approx(slow[0], rel=1e-12)
        for ours, other in zip(fast[1:], slow[1:], strict=True):
            np.testing.assert_allclose(ours, other, atol=1e-11 * np.abs(other).max())


def test_what_a_wall_remembers_turns_with_it(koiter):
    """A squeezed and relaxed shell turned as a whole feels the same forces, turned."""
    wall, positions = _held_wall(koiter)
    turn = np.linalg.qr(np.random.default_rng(6).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    energy, force = wall.gradient(positions)
    turned_energy, turned = wall.gradient(positions @ turn.T + 0.3)
    assert turned_energy == pytest.approx(energy, rel=1e-10)
    np.testing.assert_allclose(turned, force @ turn.T, atol=1e-9 * np.abs(force).max())


def _volterra(times):
    """Creep compliance J at rising times (t,) [s] from 0: integral of g(t - s) dJ(s) = 1.

    J is piecewise linear on a grid fine enough not to matter; the mean of g over each piece is
    exact for the law's terms.
    """
    grid = np.concatenate([[0.0], np.geomspace(1e-4, times[-1], 3000)])
    change = np.zeros(len(grid))
    change[0] = 1.0 / float(LAW(0.0))
    for n in range(1, len(grid)):
        since = grid[n] - grid[: n + 1]
        width = np.diff(grid[: n + 1])
        decay = np.exp(-since[1:, None] / LAW.times) - np.exp(-since[:-1, None] / LAW.times)
        mean = LAW.long_term + (decay * LAW.shares * LAW.times).sum(axis=1) / width
        past = float(LAW(grid[n])) * change[0] + mean[:-1] @ change[1:n]
        change[n] = (1.0 - past) / mean[-1]
    return np.interp(times, grid, np.cumsum(change))


@pytest.mark.parametrize('theory', ['koiter', 'thick'])
def test_creep_under_a_dead_load_follows_volterra(theory):
    """Within 0.1 %, at loads so small that the shell is linear."""
    grasp, times = Grasp(theory), hold_times(LAW, 1000.0)
    timed, now, depth = grasp.timed(), 0.0, []
    for time in times:
        depth.append(timed.to(grasp.under(0.01), time - now).displacement[0])
        now = time
    elastic = grasp.solver.solve(grasp.under(0.01), grasp.start).displacement[0] - grasp.touch[0]
    np.testing.assert_allclose(
        (np.array(depth) - grasp.touch[0]) / elastic, _volterra(times), 1e-3
    )


def test_a_large_creep_hardly_depends_on_its_steps(koiter, monkeypatch):
    """Half as deep again under a load that dents the ball by two walls."""
    ends = []
    for per_decade in (10, 30):
        monkeypatch.setattr('shell_deform.solve.hold.STEPS_PER_DECADE', per_decade)
        timed, now = koiter.timed(), 0.0
        for time in hold_times(LAW, 1000.0):
            state = timed.to(koiter.under(10.0), time - now)
            now = time
        ends.append(state.displacement[0] - koiter.touch[0])
    first = koiter.solver.solve(koiter.under(10.0), koiter.start).displacement[0] - koiter.touch[0]
    assert ends[1] > 1.3 * first
    assert ends[0] == pytest.approx(ends[1], rel=1e-3)


def _integral(time):
    """Integral of g up to `time` [s]: of a linear shell the force of a ramp, over its rate."""
    return LAW.long_term * time - float((LAW.shares * LAW.times) @ np.expm1(-time / LAW.times))


def test_a_ramp_and_hold_is_its_integral(koiter):
    """Within 0.2 %: 2 s of ramp in four steps, then a hold."""
    depth, duration = 2e-6, 2.0
    stiffness = koiter.solver.solve(koiter.at(depth), koiter.start).force[0] / depth
    timed, now = koiter.timed(), 0.0
    for time in (0.5, 1.0, 1.5, 2.0, 2.5, 10.0, 600.0):
        force = timed.to(koiter.at(depth * min(time / duration, 1.0)), time - now).force[0]
        now = time
        since_end = max(time - duration, 0.0)
        exact = stiffness * depth / duration * (_integral(time) - _integral(since_end))
        assert force == pytest.approx(exact, rel=2e-3)


def test_a_squeeze_and_release_leaves_a_loop_and_a_slow_one_a_smaller_one(koiter):
    """What a linear wall dissipates at this small travel is known: its loop is compared."""
    squeeze = np.linspace(0.0, 2e-6, 9)
    path = np.concatenate([squeeze[1:], squeeze[-2::-1]])
    stiffness = koiter.solver.solve(koiter.at(2e-6), koiter.start).force[0] / 2e-6
    for half in (1.0, 100.0):
        timed, force = koiter.timed(), [0.0]
        for depth in path:
            force.append(timed.to(koiter.at(depth), half / 8).force[0])
        work = np.trapezoid(force, np.concatenate([[0.0], path]))
        rate = stiffness * 2e-6 / half
        at = half * np.linspace(0.0, 2.0, 17)
        up, back = (np.array([_integral(t) for t in np.maximum(at - d, 0.0)]) for d in (0.0, half))
        exact = rate * (up - 2.0 * back)
        loop = np.trapezoid(exact, np.concatenate([[0.0], path]))
        assert work > 0.0
        assert work == pytest.approx(loop, rel=2e-3)


def test_gas_does_not_relax():
    """Of a ball with air the force falls by less than the law: the air carries a part."""
    grasp = Grasp('koiter', 'sealed')
    timed = grasp.timed()
    timed.to(grasp.at(0.006), 0.0)
    first = timed.to(grasp.at(0.006), 0.1).force[0]
    last = timed.to(grasp.at(0.006), 999.9).force[0]
    fall = float(LAW(1000.0) / LAW(0.1))
    assert fall * first < last < (fall + 0.2 * (1.0 - fall)) * first


def test_an_elastic_solve_after_a_hold_is_as_before(koiter):
    before = koiter.solver.solve(koiter.at(0.003), koiter.start)
    timed = koiter.timed()
    timed.to(koiter.at(0.004), 5.0)
    after = koiter.solver.solve(koiter.at(0.003), koiter.start)
    assert np.array_equal(before.positions, after.positions)


def test_time_that_runs_back_and_linear_theory_are_refused(koiter):
    with pytest.raises(RelaxationError, match='time runs back'):
        koiter.timed().to(koiter.at(0.001), -1.0)
    with pytest.raises(LoadCaseError, match='linear theory takes no holds'):
        Grasp('linear').timed()


BALL_R, BALL_H, BALL_E, BALL_NU = 0.03, 6e-4, 2e6, 0.45


def _blown(law, pressure, times):
    """Stretches at `times` [s] of a sphere under a dead pressure from 0 on: Volterra's equation.

    Both principal strains are one, so that it is exact, bending included; the integral is summed
    by Simpson's rule over all of the past, with no terms and no recursion.
    """
    wall, bending = BALL_H * BALL_E / (1.0 - BALL_NU), BALL_H**2 / (6.0 * BALL_R**2)

    def missing(stretch, strain, curvature):
        inner = wall * (2.0 * stretch * strain + bending * curvature)
        return inner - pressure * BALL_R * stretch**2

    def green(stretch):
        return 0.5 * (stretch**2 - 1.0)

    grid = np.concatenate([[0.0], np.geomspace(0.02 * times[0], times[-1], 500)])
    found = np.zeros(len(grid))
    g = float(law(0.0))
    found[0] = brentq(lambda x: missing(x, g * green(x), g * (x - 1.0)), 1.0, 3.0)
    for k in range(1, len(grid)):
        begin, end, now = grid[:k], grid[1 : k + 1], grid[k]
        middle = 0.5 * (begin + end)
        mean = (law(now - begin) + 4.0 * law(now - middle) + law(now - end)) / 6.0
        past = [
            float(law(now)) * values[0] + float(mean[:-1] @ np.diff(values))
            for values in (green(found[:k]), found[:k] - 1.0)
        ]
        last, share = found[k - 1], mean[-1]

        def balance(x, past=past, last=last, share=share):
            strain = past[0] + share * (green(x) - green(last))
            return missing(x, strain, past[1] + share * (x - last))

        found[k] = brentq(balance, 1.0, 3.0)
    return found[0], np.interp(times, grid, found)


@pytest.mark.parametrize(
    'law', [log_law(0.05, 0.1, 1000.0), prony([0.2, 0.15], [1.0, 50.0])], ids=['log', 'prony']
)
def test_a_ball_blown_far_creeps_as_volterra_says(law):
    """From 18 to 25 and from 20 to 32 % of stretch: 0.1 % of the creep, large strains."""
    blown = 1.2
    pressure = BALL_H * BALL_E / (1.0 - BALL_NU) * (blown - 1.0 / blown) / BALL_R
    ball = ShellObject(
        'ball', Sphere(2.0 * BALL_R + BALL_H), BALL_H, BALL_E, BALL_NU, pressure_pa=pressure
    )
    model = build_model(ball, 'koiter', 200)
    solver, case = EquilibriumSolver(model), forced((), [])
    timed = TimedSolver(solver, law, case, solver.rest())
    timed.state = alone(solver)
    radius = np.linalg.norm(model.surface.limit_positions(model.rest), axis=1).mean()
    times, stretches, now = hold_times(law, 1000.0), [], 0.0
    for time in times:
        held = timed.to(case, time - now)
        assert held.converged
        now = time
        points = model.surface.limit_positions(held.positions)
        stretches.append(np.linalg.norm(points, axis=1).mean() / radius)
    first, others = _blown(law, pressure, times[1:])
    assert stretches[0] == pytest.approx(first, rel=1e-5)
    np.testing.assert_allclose(stretches[1:], others, atol=1e-3 * (others[-1] - first))


@pytest.mark.soak
@pytest.mark.parametrize(
    'law', [log_law(0.08, 0.1, 1000.0), prony([0.3, 0.2], [0.5, 30.0])], ids=['log', 'prony']
)
def test_a_deep_dent_that_is_held_and_let_go_is_that_of_the_axisymmetric_solver(law):
    """6 mm, 2.4 walls, in 2 s, held, released: forces and loop within 0.2 %."""
    ball = load_object('tennis_ball')
    ball = replace(ball, gas=replace(ball.gas, kind='none'))
    times = np.array([0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 10.0, 60.0, 600.0, 601.0, 601.5])
    depths = 1e-3 * np.array([0.0, 1.5, 3.0, 4.5, 6.0, 6.0, 6.0, 6.0, 6.0, 3.0, 1.5])
    sphere = PinnedSphere(31.25e-3, 2.5e-3, ball.young_modulus_pa, 0.5, PIN)
    expected = held_forces(sphere, law, times, depths)
    model = build_model(ball, 'koiter', 500, refine_radius=PIN)
    contacts = object_contacts(ball, model, PIN)
    solver = EquilibriumSolver(model)
    start, touch = first_touch(solver, contacts)
    timed = TimedSolver(solver, law, displaced(contacts, touch), start)
    force = [0.0]
    for step, depth in zip(np.diff(times), depths[1:], strict=True):
        force.append(timed.to(displaced(contacts, touch + depth), step).force[0])
    np.testing.assert_allclose(force, expected, atol=2e-3 * expected.max())
    ours, theirs = (np.trapezoid(one, depths) for one in (force, expected))
    assert ours == pytest.approx(theirs, rel=2e-3)
