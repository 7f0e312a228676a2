# SPDX-License-Identifier: Apache-2.0
"""shell_solve as its user meets it."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

from shell_deform.commands import shell_solve
from shell_deform.commands.shell_solve_hold import Held, print_hold
from shell_deform.objects.loader import shipped_text

# Independent axisymmetric solution, Koiter, E 1 MPa, pin radius 2 mm: mm, N.
REFERENCE = {1: 0.4354723, 2: 0.7319933, 4: 1.0507244, 8: 1.3476179, 12: 1.6447264}


def test_graded_ball_follows_the_independent_solution_within_half_a_percent(capsys):
    arguments = ['--object', 'tennis_ball_as_printed', '--displacement-sweep', '0:0.012:12']
    arguments += ['--theory', 'koiter', '--pin-radius', '0.002', '--json']
    assert shell_solve.main(arguments) == 0
    result = json.loads(capsys.readouterr().out)
    assert result['object'] == 'tennis_ball_as_printed'
    assert result['theory'] == 'koiter'
    assert result['vertices'] <= 700
    assert len(result['points']) == 13
    for depth, reference in REFERENCE.items():
        point = result['points'][depth]
        assert point['displacement_m'] == pytest.approx(1e-3 * depth)
        assert point['force_n'] == pytest.approx(reference, rel=5e-3)
        assert point['stable'] is True
    assert set(result['points'][0]) >= {
        'displacement_m', 'force_n', 'energy_j', 'iterations', 'seconds', 'stable',
    }  # fmt: skip


def test_published_rows_are_predicted_from_the_first_one(capsys):
    forces = '10.631,16.503,20.373,21.485'
    command = ['--object', 'tennis_ball', '--theory', 'koiter', '--force', forces, '--json']
    assert shell_solve.main(command) == 0
    points = json.loads(capsys.readouterr().out)['points']
    published = [2.56e-3, 6.05e-3, 9.12e-3, 10.27e-3]
    assert points[0]['displacement_m'] == pytest.approx(published[0], abs=0.02e-3)
    for point, measured in zip(points[1:], published[1:], strict=True):
        assert point['displacement_m'] == pytest.approx(measured, rel=0.12)


def test_linear_theory_misses_the_published_rows_by_more_than_thirty_percent(capsys):
    forces = '10.631,16.503,20.373,21.485'
    command = ['--object', 'tennis_ball', '--young', '8.1e6', '--theory', 'linear']
    assert shell_solve.main([*command, '--force', forces, '--json']) == 0
    points = json.loads(capsys.readouterr().out)['points']
    assert points[0]['displacement_m'] == pytest.approx(2.56e-3, rel=0.05)
    for point, measured in zip(points[1:], [6.05e-3, 9.12e-3, 10.27e-3], strict=True):
        assert point['displacement_m'] < 0.7 * measured


def test_an_unknown_object_is_refused_in_one_sentence(capsys):
    assert shell_solve.main(['--object', 'tenis_ball', '--force', '1']) == 1
    error = capsys.readouterr().err.strip()
    assert 'tenis_ball' in error and '\n' not in error


@pytest.mark.parametrize('sweep', ['0:1', '0:0.01:0', 'a:b:c', '0:inf:3'])
def test_a_malformed_sweep_is_a_usage_error(sweep):
    with pytest.raises(SystemExit) as stop:
        shell_solve.main(['--object', 'tennis_ball', '--displacement-sweep', sweep])
    assert stop.value.code == 2


def test_mesh_and_picture_are_written(tmp_path, capsys):
    mesh, picture = tmp_path / 'ball.ply', tmp_path / 'ball.png'
    command = ['--object', 'tennis_ball', '--theory', 'koiter', '--vertices', '250']
    command += ['--force', '5']
    assert shell_solve.main([*command, '--mesh', str(mesh), '--picture', str(picture)]) == 0
    assert mesh.read_bytes().startswith(b'ply')
    assert picture.read_bytes().startswith(b'\x89PNG')
    assert 'tennis_ball' in capsys.readouterr().out


def test_rows_that_converged_are_printed_before_the_sentence_that_says_where_it_ended(capsys):
    command = ['--object', 'tennis_ball', '--theory', 'koiter', '--vertices', '250']
    assert shell_solve.main([*command, '--displacement-sweep', '0:0.09:3', '--json']) == 1
    captured = capsys.readouterr()
    result = json.loads(captured.out)
    assert 1 <= len(result['points']) < 4
    assert result['points'][0]['force_n'] == pytest.approx(0.0, abs=1e-9)
    assert result['message'] and result['message'] in captured.err
    assert captured.err.strip().endswith(result['message'])


def test_headings_keep_their_units_and_the_theory_that_nobody_chose_is_told(capsys):
    command = ['--object', 'tennis_ball', '--vertices', '250']
    assert shell_solve.main([*command, '--displacement-sweep', '0:0.001:1']) == 0
    told, notes = capsys.readouterr()
    assert 'thick theory' in told
    assert 'theory thick: the wall is 0.084 of the radius of curvature' in notes
    assert all(f'[{unit}]' in told for unit in ('mm', 'N', 'mJ', 'kPa'))
    assert '-0' not in told and 'e-' not in told


def test_the_table_tells_millimetres_millijoules_and_kilopascals_of_what_json_tells_in_si(capsys):
    command = ['--object', 'tennis_ball', '--theory', 'koiter', '--vertices', '200']
    command += ['--displacement-sweep', '0:0.002:1']
    assert shell_solve.main([*command, '--json']) == 0
    point = json.loads(capsys.readouterr().out)['points'][-1]
    assert shell_solve.main(command) == 0
    rows = [line.split() for line in capsys.readouterr().out.splitlines()]
    depth, push, energy, gas = map(float, next(r for r in rows if r[:1] == ['2.0000'])[:4])
    assert depth == pytest.approx(1e3 * point['displacement_m'])
    assert push == pytest.approx(point['force_n'], rel=1e-4)
    assert energy == pytest.approx(1e3 * point['energy_j'], rel=1e-4)
    assert gas == pytest.approx(1e-3 * point['gas_pressure_pa'], rel=1e-3)


def test_the_gas_of_a_ball_at_rest_is_a_plain_zero_on_a_coarse_mesh(capsys):
    # Its volume is that of the rounded mesh to some 1e-16.
    command = ['--object', 'tennis_ball', '--theory', 'koiter', '--vertices', '200']
    assert shell_solve.main([*command, '--displacement-sweep', '0:0.001:1']) == 0
    assert 'e-' not in capsys.readouterr().out


def test_a_hold_relaxes_at_constant_travel_and_says_what_is_beyond_its_law(tmp_path, capsys):
    path = tmp_path / 'ball.yaml'
    law = 'relaxation: {kind: log, share_per_decade: 0.03, from_s: 0.1, to_s: 100}'
    path.write_text(shipped_text('tennis_ball_as_printed') + law + '\n')
    arguments = ['--object', str(path), '--theory', 'koiter', '--vertices', '100']
    arguments += ['--displacement-sweep', '0:0.002:1']
    assert shell_solve.main([*arguments, '--hold', '600', '--json']) == 0
    told = capsys.readouterr()
    document = json.loads(told.out)
    held = document['hold']
    assert [held[0]['time_s'], held[-1]['time_s']] == [0.0, pytest.approx(600.0)]
    assert held[-1]['displacement_m'] == pytest.approx(0.002, abs=1e-12)
    # young_modulus_pa is that of 0.1 s after a step
    fallen = held[-1]['force_n'] / document['points'][-1]['force_n']
    assert fallen == pytest.approx(1.0 - 0.03 * np.log10(6000.0), abs=1e-4)
    assert '600 s is longer than the 100 s that the relaxation is known for' in told.err
    assert held[-1]['relative_sigma'] > 0.02
    assert shell_solve.main([*arguments, '--hold', '1e300']) == 1
    told = capsys.readouterr().err.strip()
    assert told.endswith('--hold 1e+300: 301 decades of time; at most 15; hold it for less')
    assert len(told.splitlines()) == 1


def test_a_hold_is_printed_a_few_times_a_decade_in_mm_newtons_and_percent(capsys):
    held = [
        Held(time, SimpleNamespace(force=np.array([8.0, 6.0]), gas_pressure=0.0), 0.002, 0.05)
        for time in (0.0, 1.0, 1.1, 4.0, 10.0, 11.0)
    ]
    print_hold(held)
    rows = [line.split() for line in capsys.readouterr().out.splitlines()]
    rows = [list(map(float, row)) for row in rows if row and row[0][0].isdigit()]
    assert [row[0] for row in rows] == [0.0, 1.0, 4.0, 11.0]
    assert all(row[1:] == [2.0, 7.0, 5.0] for row in rows)


def test_a_hold_of_an_elastic_object_or_a_linear_theory_is_refused(tmp_path, capsys):
    arguments = ['--vertices', '100', '--force', '1', '--hold', '10']
    assert shell_solve.main(['--object', 'tennis_ball', *arguments]) == 1
    assert '--hold needs relaxation: in the object file' in capsys.readouterr().err
    path = tmp_path / 'ball.yaml'
    law = 'relaxation: {kind: prony, shares: [0.1], times_s: [5]}'
    path.write_text(shipped_text('tennis_ball_as_printed') + law + '\n')
    assert shell_solve.main(['--object', str(path), '--theory', 'linear', *arguments]) == 1
    assert 'linear theory takes no holds' in capsys.readouterr().err


def test_contacts_of_the_command_line_take_the_place_of_those_of_the_file(capsys):
    """A ball answers alike wherever it is pressed; pins wider than its own give less."""
    forces = []
    for contacts in (
        (),
        ('--contact', '0,0,0.0325', '--contact', '0,0,-0.0325'),
        ('--contact', '-0.0325,0,0,0.003', '--contact', '0.0325,0,0,0.003'),
    ):
        words = ['--object', 'tennis_ball', '--theory', 'koiter', '--vertices', '300']
        words += [*contacts, '--json']
        assert shell_solve.main([*words, '--displacement-sweep', '0:5e-4:1']) == 0
        forces.append(json.loads(capsys.readouterr().out)['points'][-1]['force_n'])
    assert forces[1] == pytest.approx(forces[0], rel=0.01)
    assert forces[2] > 1.05 * forces[0]


def test_an_object_without_contacts_names_both_ways_to_give_them(tmp_path, capsys):
    text = shipped_text('tennis_ball')
    (tmp_path / 'ball.yaml').write_text(text[: text.index('contacts:')])
    assert shell_solve.main(['--object', str(tmp_path), '--force', '1']) == 1
    said = capsys.readouterr().err
    assert 'add contacts: [{at_m: [x, y, z]}]' in said and '--contact X,Y,Z' in said
