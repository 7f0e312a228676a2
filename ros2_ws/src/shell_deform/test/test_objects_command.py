# SPDX-License-Identifier: Apache-2.0
"""The command `shell_objects`."""

import json

import pytest

from shell_deform.commands.shell_objects import main


def test_json_is_one_document_with_every_number(capsys):
    assert main(['--json', 'tennis_ball']) == 0
    (ball,) = json.loads(capsys.readouterr().out)['objects']
    assert ball['surface'] == {'sphere': {'outer_diameter_m': 0.065}}
    assert ball['gas'] == {'kind': 'sealed', 'gauge_pressure_pa': 0.0, 'ambient_pa': 101325.0}
    assert len(ball['contacts']) == 2


def test_without_names_all_shipped_objects_are_shown(capsys):
    assert main([]) == 0
    text = capsys.readouterr().out
    for word in ('tennis_ball', 'half_soda', 'sealed', 'hinged'):
        assert word in text


def test_the_table_has_millimetres_megapascals_and_bar(capsys, tmp_path):
    file = tmp_path / 'object.yaml'
    file.write_text(
        'name: core\n'
        'surface: {sphere: {outer_diameter_m: 0.06}}\n'
        'thickness_m: 0.0035\n'
        'young_modulus_pa: 19.2e+6\npoisson_ratio: 0.49\n'
        'gas: {kind: sealed, gauge_pressure_pa: 83.0e+3, ambient_pa: 101325.0}\n'
        'contacts: [{at_m: [0.03, 0, 0], radius_m: 0.0025}]\n'
    )
    assert main([str(file)]) == 0
    row = next(r for r in capsys.readouterr().out.splitlines() if r.split()[:1] == ['core'])
    assert ' '.join(row.split()) == (
        'core sphere: outer diameter 60 3.5 19.2 0.49 sealed, 0.83 bar gauge - pin r 2.5'
    )


def test_the_mesh_and_its_fit_are_shown_on_request(capsys):
    assert main(['--json', '--mesh-fit', 'tennis_ball']) == 0
    mesh = json.loads(capsys.readouterr().out)['objects'][0]['mesh']
    assert mesh['maximum_error_m'] < 2.5e-6


def test_an_unknown_object_is_one_sentence_and_exit_one(capsys):
    assert main(['teapot']) == 1
    output = capsys.readouterr()
    assert output.out == ''
    assert output.err.startswith("shell_objects: no object file 'teapot'; the shipped objects are")


def test_wrong_arguments_exit_two():
    with pytest.raises(SystemExit) as caught:
        main(['--colour'])
    assert caught.value.code == 2
