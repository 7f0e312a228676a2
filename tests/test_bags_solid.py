# SPDX-License-Identifier: Apache-2.0
"""The solid truth of the recordings: what was kept, and that CalculiX gives it again."""

from __future__ import annotations

import gzip
import json
import re
import shutil

import numpy as np
import pytest
import yaml
from bags import axisymmetric, calculix, hexahedra, solid_ball, solid_can, solid_cup, solid_shell
from bags import solid_three_fingers as three
from bags.surfaces import FOLDER, BallTruth, ShellTruth

needs_calculix = [
    pytest.mark.calculix,
    pytest.mark.skipif(shutil.which('ccx') is None, reason='ccx is not installed'),
]
SHELLS = ('half_soda_can', 'ball_three_finger', 'off_axis_cup')


def kept(name: str) -> dict:
    return json.loads((FOLDER / f'{name}.json').read_text())


def test_the_published_forces_are_their_pound_forces_in_newton() -> None:
    table = yaml.safe_load(solid_ball.TABLE.read_text())
    for row in table['rows']:
        expected = row['force_lbf'] * table['newton_per_pound_force']
        assert row['force_n'] == pytest.approx(expected, rel=1e-14)


def test_the_recorded_ball_gives_the_first_published_displacement() -> None:
    row = solid_ball.published_rows('tennis_ball')[0]
    dent = BallTruth().middle_displacement(row['force_n'])
    assert dent == pytest.approx(row['measured_max_displacement_m'], abs=1e-6)


def test_the_sealed_air_of_the_ball_obeys_the_isothermal_law() -> None:
    for name in ('ball_two_finger', 'ball_three_finger', 'ball_three_finger_layered'):
        for level in kept(name)['levels']:
            absolute = 101325.0 + level['gas_gauge_pressure_pa']
            assert absolute * level['volume_ratio'] == pytest.approx(101325.0, rel=1e-4)


def test_every_kept_result_has_its_deck_and_solver_version() -> None:
    for path in FOLDER.glob('*.json'):
        assert 'CalculiX CrunchiX 2.' in kept(path.stem)['solver']
        with gzip.open(FOLDER / f'{path.stem}.inp.gz', 'rt') as deck:
            assert deck.readline() == '*HEADING\n'


def test_the_generator_writes_the_kept_deck_of_the_can_again() -> None:
    forces = np.array([level['force_n'] for level in kept('half_soda_can')['levels']])
    forces[7] = solid_ball.published_rows('half_soda_can')[0]['force_n']
    text = solid_shell.deck(solid_can.model(solid_can.HalfCan()), forces, np.zeros(len(forces)))
    with gzip.open(FOLDER / 'half_soda_can.inp.gz', 'rt') as deck:
        words = [re.split(r'[,\n]', each) for each in (deck.read(), text)]
    # Another numpy rounds a coordinate of 1e-15 mm otherwise.
    assert len(words[0]) == len(words[1])
    for old, new in zip(*words, strict=True):
        assert old == new or abs(float(old) - float(new)) < 1e-12


def test_the_can_agrees_with_the_shell_elements_of_kratos() -> None:
    can = kept('half_soda_can')
    force = solid_ball.published_rows('half_soda_can')[0]['force_n']
    truth = ShellTruth('half_soda_can')
    # Kratos: 0.726 mm linear and 0.824 mm nonlinear, under a point and with R 33 at the middle.
    assert can['linear_middle_displacement_per_newton_m'] * force == pytest.approx(
        0.726e-3, rel=0.01
    )
    assert truth.middle_displacement(force) == pytest.approx(0.824e-3, rel=0.01)


def test_a_thinner_sphere_is_closer_to_the_shell_limit() -> None:
    softness = []
    for ratio in solid_ball.SPHERE_RATIOS:
        sphere = kept(f'sphere_rh_{ratio:g}')
        assert sphere['radius_over_thickness'] == ratio
        first = sphere['levels'][0]
        h = sphere['thickness_m']
        radius = sphere['outer_radius_m'] - h / 2
        scaled_force = first['force_n'] * radius / (1e6 * h**3)
        softness.append(first['middle_displacement_m'] / h / scaled_force)
    assert softness == sorted(softness, reverse=True)


def test_the_series_that_shell_verify_ships_is_the_kept_one() -> None:
    assert solid_ball.SHIPPED.read_text() == solid_ball.shipped_series()


@pytest.mark.parametrize('name', SHELLS)
def test_the_whole_face_is_outward_and_meets_its_mirror_images(name: str) -> None:
    truth = ShellTruth(name)
    surface = truth.surface(truth.forces[-1], pieces=2)
    contact = np.array(truth.data['contacts'][0]['centre_m'])
    inward = np.array(truth.data['contacts'][0]['direction'])
    at = np.argmin(np.linalg.norm(surface.vertices - contact - inward * truth.outer[-1], axis=1))
    assert surface.normals[at] @ inward < -0.99
    edges = np.sort(surface.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    _, uses = np.unique(edges, axis=0, return_counts=True)
    assert uses.max() == 2
    assert (uses == 1).any() == (name != 'ball_three_finger')


def test_the_rest_face_of_the_ball_is_its_outer_sphere() -> None:
    for surface in (BallTruth().surface(0.0), ShellTruth('ball_three_finger').surface(0.0)):
        radius = np.linalg.norm(surface.vertices, axis=1)
        assert abs(radius - 0.0325).max() < 2e-6
        assert (np.einsum('nd,nd->n', surface.normals, surface.vertices) > 0.032).all()


def test_the_dent_of_the_ball_surface_is_the_kept_displacement() -> None:
    truth = BallTruth()
    for force in (0.0, 5.0, 21.484910401708216):
        top = truth.surface(force).vertices[:, 2].max(initial=-1, where=_near_axis(truth, force))
        assert top == pytest.approx(0.0325 - truth.outer_displacement(force), abs=2e-6)


def _near_axis(truth: BallTruth, force: float) -> np.ndarray:
    return np.hypot(*truth.surface(force).vertices[:, :2].T) < 1e-6


def test_the_pin_carries_its_whole_force() -> None:
    ball = axisymmetric.Ball(pin='traction', pin_radius=2.0)
    weights = axisymmetric.pin_weights(axisymmetric.build_mesh(ball))
    assert sum(weights.values()) == pytest.approx(1.0)
    for contact, solid in (
        (m.contacts[0], m.solid) for m in (solid_can.model(solid_can.HalfCan()),)
    ):
        shares = hexahedra.disc_shares(solid, np.array(contact.centre), contact.radius)
        assert sum(shares.values()) == pytest.approx(1.0)


def test_the_meshed_volume_is_that_of_the_sphere() -> None:
    mesh = axisymmetric.build_mesh(axisymmetric.Ball())
    volume = axisymmetric.inside_volume(mesh, mesh.positions)
    assert volume == pytest.approx(4 / 3 * np.pi * 30.0**3, rel=1e-7)
    model = three.model(axisymmetric.Ball())
    inside = 12 * hexahedra.enclosed_volume(model.solid, model.solid.positions, np.zeros(3))
    assert inside == pytest.approx(4 / 3 * np.pi * 30.0**3, rel=1e-5)


def test_the_foot_of_the_cup_is_clamped_and_its_rim_is_free() -> None:
    model = solid_cup.model(solid_cup.Cup())
    clamped = {node for node, axis in model.fixed if axis == 3}
    heights = model.solid.positions[[node - 1 for node in clamped], 2]
    assert len(clamped) > 100
    assert abs(heights).max() < 0.05


class TestWithCalculix:
    pytestmark = needs_calculix

    def test_the_reference_table_of_the_solid_ball_is_met_within_one_percent(self) -> None:
        solution = solid_ball.reference_curve_ball()
        dents = np.concatenate([[0.0], solution.middle_displacement()])
        forces = np.interp([1, 2, 4, 8, 12], dents, np.concatenate([[0.0], solution.forces]))
        # Independent CAX8R solution of the same ball; read from its curve to +-0.3 %.
        np.testing.assert_allclose(forces, [0.3967, 0.6725, 0.9732, 1.2716, 1.5937], rtol=0.01)

    def test_the_kept_ball_is_solved_again_to_the_micrometre(self) -> None:
        data = kept('ball_two_finger')
        ball = axisymmetric.Ball(young_modulus=data['young_modulus_pa'] * 1e-6)
        level = next(row for row in data['levels'] if row['force_n'] > 10.6)
        pressure = level['gas_gauge_pressure_pa'] * 1e-6
        solution = axisymmetric.solve(ball, np.array([level['force_n']]), np.array([pressure]))
        assert solution.middle_displacement()[0] * 1e-3 == pytest.approx(
            level['middle_displacement_m'], abs=1e-6
        )

    def test_a_history_that_cannot_be_solved_is_refused_with_the_last_words(self) -> None:
        ball = axisymmetric.Ball(pin='traction', young_modulus=1.0)
        with pytest.raises(calculix.CalculixError, match='ccx ended'):
            axisymmetric.solve(ball, np.array([3.0]), np.zeros(1))
