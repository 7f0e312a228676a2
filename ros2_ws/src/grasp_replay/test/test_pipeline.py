# SPDX-License-Identifier: Apache-2.0
"""A recorded grasp through the whole pipeline: numbers, bytes, and what is refused."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from grasp_samples import (
    FORCES_N,
    POLES,
    SAMPLES_PER_HOLD,
    START_NS,
    YOUNG_PA,
    cloud,
    contacts,
    small_ball,
    write_grasp,
)
from scipy.spatial.transform import Rotation

from grasp_replay.bag_writer import BagWriter
from grasp_replay.commands.grasp_report import main
from grasp_replay.errors import BagError
from grasp_replay.experiment import read_experiment
from grasp_replay.holds import holds_of, mean_contacts
from grasp_replay.pipeline import Outcome, PipelineOptions, run
from grasp_replay.published import published_predictions
from grasp_replay.recording import read_recording
from grasp_replay.report_files import Extent, make_report
from grasp_replay.results import document, json_text, verdict
from grasp_replay.sample_trace import trace_samples
from grasp_replay.scenes import bands, curves, modulus_share

COARSE = {'control_vertices': 200}
# The samples are of a ball that Koiter's theory solved: to a thick wall they would be misfits.
THIN_WALL = PipelineOptions(changes=COARSE, thick=False)
PUBLISHED = Path(__file__).parents[4] / 'bags' / 'published' / 'table1.yaml'
CONTRACT_KEYS = {
    'mean_error_m',
    'rms_error_m',
    'p95_error_m',
    'max_error_m',
    'dent_mean_error_m',
    'max_displacement_m',
}


@pytest.fixture(scope='module')
def grasp(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_grasp(tmp_path_factory.mktemp('grasp') / 'grasp')


@pytest.fixture(scope='module')
def outcome(grasp: Path) -> Outcome:
    return run(grasp, THIN_WALL)


def test_the_modulus_is_found_again_from_the_first_load(outcome: Outcome) -> None:
    assert outcome.shell.shell.young_modulus_pa == pytest.approx(YOUNG_PA, rel=0.01)
    assert outcome.young_from == 'fitted on row 1 of this recording with koiter theory'


def test_the_forces_are_the_means_of_the_holds(outcome: Outcome) -> None:
    assert [row.force for row in outcome.rows] == pytest.approx(FORCES_N, rel=1e-6)
    assert [row.contacts.samples for row in outcome.rows] == [SAMPLES_PER_HOLD] * 2


def test_the_true_theory_is_right_to_the_noise_and_linear_theory_is_not(outcome: Outcome) -> None:
    results = document(outcome, [])
    for row in results['rows']:
        assert row['theories']['koiter']['mean_error_m'] < 1.05 * row['noise_floor_m']
        assert row['theories']['linear']['mean_error_m'] > 5 * row['noise_floor_m']
        assert row['verdict'].startswith('koiter is better than linear')


def test_the_measured_displacement_is_the_true_one_two_ways(outcome: Outcome) -> None:
    for row in document(outcome, [])['rows']:
        truth = row['measured_by_pins_m']
        assert row['measured_max_displacement_m'] == pytest.approx(truth, rel=0.01)
        assert 0.0 < row['measured_max_displacement_sigma_m'] < 0.05 * truth


def test_the_document_has_the_keys_of_the_contract(outcome: Outcome) -> None:
    results = document(outcome, [])
    assert len(results['bag_sha256']) == 64
    for row in results['rows']:
        assert {'force_n', 'measured_max_displacement_m', 'noise_floor_m', 'registration'} <= set(
            row
        )
        assert list(row['theories']) == ['linear', 'paper', 'koiter', 'thick']
        for numbers in row['theories'].values():
            assert set(numbers) >= CONTRACT_KEYS


def test_each_row_says_what_its_grasp_holds(outcome: Outcome) -> None:
    for row in document(outcome, [])['rows']:
        grasp = row['grasp']
        # Pins face to face: hardly any friction is needed, and two of them lift twice mu N.
        assert grasp['closed']
        assert grasp['needed_friction'] < 0.1
        lifted = 2.0 * grasp['friction_given'] * row['force_n']
        assert grasp['gravity_capacity_n'] == pytest.approx(lifted, rel=0.05)
        assert grasp['largest_strain'] > 0.0
        assert grasp['yields'] is None
        assert 'no gauge sees' in grasp['note']


def test_two_runs_give_the_same_bytes_without_paths(grasp: Path, outcome: Outcome) -> None:
    first = json_text(document(outcome, []))
    second = json_text(document(run(grasp, THIN_WALL), []))
    assert first == second
    assert str(grasp.parent) not in first


def test_no_verdict_where_the_force_itself_is_uncertain(outcome: Outcome) -> None:
    row = outcome.rows[0]
    vague = replace(row, contacts=replace(row.contacts, sigma=0.5 * row.contacts.push))
    assert verdict(vague).startswith('no verdict: the force is known to 50 % only')


def test_the_object_may_keep_its_own_modulus(grasp: Path) -> None:
    outcome = run(grasp, replace(THIN_WALL, young='object'))
    assert outcome.shell.shell.young_modulus_pa == 12.75e6
    assert outcome.young_from == 'object tennis_ball'


def test_linear_theory_at_every_sample_is_proportional_to_the_force(outcome: Outcome) -> None:
    trace = trace_samples(outcome.recording, outcome.shell)
    assert len(trace.time_s) == 3 * SAMPLES_PER_HOLD
    touching = trace.contacts == 2
    assert touching.sum() == 2 * SAMPLES_PER_HOLD
    share = trace.linear_displacement_m[touching] / trace.force_n[touching]
    assert share == pytest.approx(np.full(len(share), share[0]), rel=1e-6)
    assert trace.linear_displacement_m[~touching].max() == 0.0
    linear = outcome.rows[0].solved['linear'].surface
    assert linear is not None
    assert trace.linear_displacement_m[touching][0] == pytest.approx(
        linear.max_displacement, rel=1e-3
    )


def test_without_a_description_the_first_scan_is_the_undeformed_one(
    grasp: Path, tmp_path: Path
) -> None:
    for file in grasp.iterdir():
        if file.name != 'experiment.yaml':
            (tmp_path / file.name).write_bytes(file.read_bytes())
    holds = holds_of(read_recording(tmp_path), read_experiment(tmp_path))
    assert [hold.contacts is None for hold in holds] == [True, False, False]
    assert [h.contacts.push.mean() for h in holds if h.contacts] == pytest.approx(FORCES_N)


def test_samples_with_impossible_numbers_are_left_out_of_the_mean(grasp: Path) -> None:
    samples = list(read_recording(grasp).samples[SAMPLES_PER_HOLD : SAMPLES_PER_HOLD + 10])
    samples[3] = replace(samples[3], force=np.full((2, 3), np.nan))
    found = mean_contacts(samples)
    assert found is not None
    assert found.samples == 9
    assert found.push == pytest.approx(FORCES_N[0])


def _bag(directory: Path, *, touching: bool = True, scans: int = 2, force: float = 5.0) -> Path:
    with BagWriter(directory) as writer:
        cells = writer.add_topic('/hand/contacts', 'sensor_msgs/msg/PointCloud2')
        points = writer.add_topic('/scan/points', 'sensor_msgs/msg/PointCloud2')
        for i in range(50 if touching else 0):
            now = START_NS + i * 20_000_000
            writer.write(cells, contacts(now, POLES, -POLES / 0.0325, force, 0.0), now)
        sphere = np.random.default_rng(0).standard_normal((500, 3))
        sphere *= 0.0325 / np.linalg.norm(sphere, axis=1)[:, None]
        for i in range(scans):
            now = START_NS + (i + 1) * 500_000_000
            writer.write(points, cloud(now, {a: sphere[:, k] for k, a in enumerate('xyz')}), now)
    return directory


def test_a_bag_without_contact_topic_is_refused_with_what_it_has(tmp_path: Path) -> None:
    with BagWriter(tmp_path / 'bag') as writer:
        writer.add_topic('/other', 'std_msgs/msg/String')
    with pytest.raises(BagError, match='has no topic hand/contacts; it has /other'):
        run(tmp_path / 'bag', PipelineOptions())


def test_a_bag_with_nothing_but_the_undeformed_scan_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BagError, match='no scan under load'):
        run(_bag(tmp_path / 'bag', scans=1), PipelineOptions())


def test_a_hold_without_contact_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BagError, match='nothing touches in the 0.50 s of the hold'):
        run(_bag(tmp_path / 'bag', force=0.0), PipelineOptions())


def test_a_scan_that_the_experiment_names_but_the_bag_lacks_is_named(tmp_path: Path) -> None:
    bag = _bag(tmp_path / 'bag')
    (bag / 'experiment.yaml').write_text(
        yaml.safe_dump({'scans': [{'scan_stamp_ns': 5, 'kind': 'held'}]})
    )
    with pytest.raises(BagError, match='no scan has the stamp 5 ns'):
        run(bag, PipelineOptions())


def test_an_unknown_object_is_refused_with_the_known_ones(tmp_path: Path) -> None:
    with pytest.raises(BagError, match='the shipped objects are'):
        run(_bag(tmp_path / 'bag'), PipelineOptions(object_name='melon'))


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('[', 'cannot be read'),
        ('- 1', 'no table'),
        ('scanner: {noise_sigma_m: -1}', 'noise_sigma_m is -1'),
        ('scanner: {noise_sigma_m: wide}', "is 'wide', not a number"),
        ('object_pose: [1, 2]', 'not x y z qx qy qz qw'),
        ('scans: [{kind: held}]', 'a scan without scan_stamp_ns'),
        ('friction: 11', 'friction is 11.0; it lies between 0 and 10'),
        ('friction_sigma: -0.1', 'friction_sigma is -0.1; it lies between 0'),
        ('mass_kg: -1', 'mass_kg is -1.0; it lies between 0 and 1000'),
        ('mass_kg: .nan', 'mass_kg is nan, not finite'),
        ('mass_kg: heavy', "mass_kg is 'heavy', not a number"),
        ('down: [0, 0, 0]', 'a direction is not all zero'),
        ('down: below', "down is 'below', not x y z"),
    ],
)
def test_a_broken_description_is_one_sentence(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / 'experiment.yaml').write_text(text)
    with pytest.raises(BagError, match=message):
        read_experiment(tmp_path)


def test_windows_of_a_description_are_seconds_after_its_start(tmp_path: Path) -> None:
    (tmp_path / 'experiment.yaml').write_text(
        'start_ns: 7000000000\n'
        'scans:\n'
        '- {scan_stamp_ns: 9000000000, hold: {from_s: 0.5, to_s: 2.25, published_row: 3}}\n'
        '- {scan_stamp_ns: 8000000000, kind: undeformed}\n'
        '- {scan_stamp_ns: 9000000000, hold: {}}\n'
    )
    described = read_experiment(tmp_path)
    first, second, third = described.scans
    assert first.window == (7_500_000_000, 9_250_000_000)
    assert (first.held, first.published_row) == (True, 3)
    assert (second.held, second.window, second.published_row) == (False, None, None)
    # A hold without a time is the start of the recording.
    assert third.window == (7_000_000_000, 7_000_000_000)
    assert described.down == (0.0, 0.0, -1.0) and described.mass == 0.0


def test_files_are_written_as_a_whole_and_leave_nothing_else(grasp: Path, tmp_path: Path) -> None:
    out = tmp_path / 'out'
    make_report(grasp, out, PipelineOptions(changes=COARSE), Extent(page=True))
    assert sorted(path.name for path in out.iterdir()) == [
        'pictures',
        'report.html',
        'results.json',
        'samples.csv',
        'table.csv',
    ]
    assert sorted(path.name for path in (out / 'pictures').iterdir()) == ['row_1.png', 'row_2.png']
    page = (out / 'report.html').read_text()
    assert 'SYNTHETIC: made by the tests' in page
    assert 'Friction that closure needs' in page
    assert 'load 2 of 2' in page and 'sha256 of results.json' in page and 'numpy' in page


def test_curves_carry_what_row_1_leaves_open_of_the_modulus(outcome: Outcome) -> None:
    drawn = {curve.name: curve for curve in curves(outcome, [])}
    koiter = drawn['koiter']
    share = modulus_share(outcome, koiter)
    # The samples' forces are known to 0.5 %, each finger by itself.
    assert 0.003 < share < 0.03
    assert koiter.upper_n is not None
    assert koiter.upper_n[-1] == pytest.approx((1 + share) * FORCES_N[-1])
    assert f'{100 * share:.1f} %' in bands(outcome, list(drawn.values()))
    assert len(koiter.force_n) > 10 and np.all(np.diff(koiter.displacement_m) > 0.0)


def test_a_modulus_that_was_not_fitted_has_no_band(outcome: Outcome) -> None:
    own = replace(outcome, young_from='object tennis_ball')
    assert all(curve.lower_n is None for curve in curves(own, []))


def test_a_failed_run_leaves_no_results(grasp: Path, tmp_path: Path) -> None:
    with pytest.raises(BagError):
        make_report(grasp, tmp_path / 'out', PipelineOptions(object_name='melon'), Extent())
    assert not (tmp_path / 'out').exists()


def test_the_command_prints_json_alone_and_names_failures(
    grasp: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    only = ['--no-page', '--no-samples', '--no-thick', '--json']
    assert main([str(grasp), '--out', str(tmp_path / 'out'), *only]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed == json.loads((tmp_path / 'out' / 'results.json').read_text())
    assert main([str(tmp_path / 'nothing'), '--out', str(tmp_path / 'out')]) == 1
    assert 'does not exist' in capsys.readouterr().err


def test_published_rows_are_predicted_by_koiter_theory_and_missed_by_linear() -> None:
    rows = published_predictions(PUBLISHED, 'tennis_ball', 'tennis_ball')
    assert len(rows) == 4
    for row in rows[1:]:
        measured = row['measured_max_displacement_m']
        predicted = row['predicted_max_displacement_m']
        assert predicted['koiter'] == pytest.approx(measured, rel=0.15)
        assert abs(predicted['linear'] / measured - 1.0) > 0.3


@pytest.fixture(scope='module')
def recorded() -> Outcome:
    return run(PUBLISHED.parents[1] / 'tennis_ball_two_finger', PipelineOptions())


def test_on_the_recorded_ball_koiter_theory_is_nearer_than_linear_theory(
    recorded: Outcome,
) -> None:
    rows = document(recorded, [])['rows']
    assert [row['published_row'] for row in rows] == [1, 2, 3, 4]
    for row in rows:
        koiter, linear = (row['theories'][name]['mean_error_m'] for name in ('koiter', 'linear'))
        assert koiter < linear
        assert koiter < 2.0 * row['noise_floor_m']
    assert rows[3]['verdict'].startswith('koiter is better than linear')


def test_on_the_recorded_ball_a_wall_with_a_thickness_is_the_nearest(recorded: Outcome) -> None:
    results = document(recorded, [])
    assert results['solid_young_modulus_pa'] == pytest.approx(14.196e6, rel=0.02)
    for row in results['rows'][1:]:
        thick, koiter = (
            row['theories'][name]['dent_mean_error_m'] for name in ('thick', 'koiter')
        )
        # Deep dents are where the thin wall is off.
        assert thick < (0.85 if row['force_n'] > 20.0 else 1.0) * koiter


def test_a_scan_is_laid_on_the_theory_that_is_nearest_to_its_wall(
    recorded: Outcome, outcome: Outcome
) -> None:
    assert {row['registered_by'] for row in document(recorded, [])['rows']} == {'thick'}
    assert {row['registered_by'] for row in document(outcome, [])['rows']} == {'koiter'}


def test_the_recorded_cup_says_that_its_pins_did_not_rub(outcome: Outcome) -> None:
    assert read_experiment(PUBLISHED.parents[1] / 'cup_off_axis').pins_slide
    row, ball = outcome.rows[0], outcome.shell.with_young(YOUNG_PA)
    assert not any(patch.slides for patch in row.patches)
    ball.pins_slide = True
    assert all(patch.slides for patch in ball.with_young(YOUNG_PA).patches(row.contacts))


def test_whether_pins_rubbed_is_true_or_false(tmp_path: Path) -> None:
    (tmp_path / 'experiment.yaml').write_text('pins_slide: a little')
    with pytest.raises(BagError, match="pins_slide is 'a little', neither true nor false"):
        read_experiment(tmp_path)


def test_an_object_without_published_rows_has_none() -> None:
    assert published_predictions(PUBLISHED, 'tennis_ball', 'melon') == []


def test_the_truth_of_the_samples_is_carried_by_the_solver() -> None:
    assert small_ball().shell.young_modulus_pa == YOUNG_PA


def test_a_dent_that_leads_nowhere_when_the_pins_press_elsewhere_is_left_for_rest() -> None:
    ball = small_ball()
    turned = POLES @ Rotation.from_euler('y', 4.0, degrees=True).as_matrix().T
    before, after = (
        tuple(ball.model.contact(pole, 1e-3) for pole in poles) for poles in (POLES, turned)
    )
    dented = ball.solve('thick', before, np.full(2, 8.0)).state
    found, anew = (ball.solve('thick', after, np.full(2, 9.0), start) for start in (dented, None))
    assert found.state is not None and anew.state is not None
    assert found.state.converged
    assert found.state.displacement == pytest.approx(anew.state.displacement, rel=1e-6)
