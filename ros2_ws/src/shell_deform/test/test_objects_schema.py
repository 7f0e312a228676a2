# SPDX-License-Identifier: Apache-2.0
"""The JSON Schema of the object file says what the reader does, and the reference says it too."""

import copy
import json
from pathlib import Path

import pytest
import yaml

from shell_deform.commands.shell_objects import main
from shell_deform.objects import ObjectError, load_object, object_names
from shell_deform.objects.loader import shipped_text
from shell_deform.objects.reference import reference_table, schema

DOCS = Path(__file__).parents[4] / 'docs' / 'object_file.md'


NOTHING = {'required': ()}


def _fits(value, node):
    """Validation against the few words of JSON Schema that the document uses."""
    if 'anyOf' in node and 'type' not in node:
        return any(_fits(value, inner) for inner in node['anyOf'])
    if 'enum' in node:
        return value in node['enum']
    kind = node['type']
    if kind == 'object':
        known = node['properties']
        return (
            isinstance(value, dict)
            and set(node.get('required', ())) <= set(value) <= set(known)
            and any(set(one['required']) <= set(value) for one in node.get('anyOf', [NOTHING]))
            and node.get('minProperties', 0) <= len(value) <= node.get('maxProperties', len(value))
            and all(_fits(inner, known[key]) for key, inner in value.items())
        )
    if kind == 'array':
        return (
            isinstance(value, list)
            and node.get('minItems', 0) <= len(value) <= node.get('maxItems', len(value))
            and all(_fits(inner, node['items']) for inner in value)
        )
    if kind == 'string':
        return isinstance(value, str) and len(value) >= node.get('minLength', 0)
    numbers = int if kind == 'integer' else (int, float)
    return (
        isinstance(value, numbers)
        and not isinstance(value, bool)
        and value > node.get('exclusiveMinimum', -float('inf'))
        and node.get('minimum', -float('inf')) <= value <= node.get('maximum', float('inf'))
    )


BALL = yaml.safe_load(shipped_text('tennis_ball'))
SURFACES = {
    'ellipsoid': {'outer_diameters_m': [0.06, 0.07, 0.08]},
    'cylinder': {'outer_diameter_m': 0.066, 'length_m': 0.1, 'ends': 'closed'},
    'half_cylinder': {'outer_diameter_m': 0.066, 'length_m': 0.1},
    'cone': {'outer_diameters_m': [0.06, 0.08], 'length_m': 0.1},
    'revolution': {'outer_profile_m': [[0.0, 0.0], [0.03, 0.0], [0.03, 0.1]]},
}


def _loads(document, folder):
    path = folder / 'object.yaml'
    path.write_text(yaml.safe_dump(document))
    try:
        load_object(path)
    except ObjectError:
        return False
    return True


@pytest.mark.parametrize('name', object_names())
def test_every_shipped_object_fits_the_schema(name):
    assert _fits(yaml.safe_load(shipped_text(name)), schema())


@pytest.mark.parametrize('kind', SURFACES)
def test_every_primitive_is_read_and_fits(kind, tmp_path):
    document = {**BALL, 'surface': {kind: SURFACES[kind]}, 'gas': {'kind': 'none'}}
    document['contacts'] = []
    assert _fits(document, schema())
    assert _loads(document, tmp_path)


def _changes():
    """Documents with one thing wrong, by what it is."""
    for key in ('name', 'surface', 'thickness_m', 'young_modulus_pa', 'poisson_ratio'):
        document = copy.deepcopy(BALL)
        del document[key]
        yield f'no {key}', document
    for key, value in (
        ('colour', 'yellow'), ('thickness_m', 0.0), ('thickness_m', 'thin'), ('thickness_m', []),
        ('young_modulus_pa', -1.0), ('poisson_ratio', 0.6), ('name', ''), ('control_vertices', 5),
        ('control_vertices', 100.5), ('surface', {}), ('surface', {'cube': {'side_m': 0.1}}),
        ('surface', {'sphere': {'diameter_m': 0.065}}), ('gas', {'kind': 'helium'}),
        ('contacts', [{'radius_m': 0.001}]), ('contacts', [{'at_m': [0.0325, 0.0]}]),
        ('contacts', [{'at_m': [0.0325, 0, 0], 'kind': 'nail'}]),
        ('supports', [{'kind': 'glued', 'where': 'x=0'}]), ('yield_stress_pa', 0.0),
    ):  # fmt: skip
        yield f'{key} {value}', {**copy.deepcopy(BALL), key: value}


@pytest.mark.parametrize('document', [pytest.param(wrong, id=what) for what, wrong in _changes()])
def test_what_the_schema_refuses_the_reader_refuses(document, tmp_path):
    assert not _fits(document, schema())
    assert not _loads(document, tmp_path)


def test_a_contact_needs_its_place_only(tmp_path):
    document = {**BALL, 'contacts': [{'at_m': [0.0325, 0.0, 0.0]}]}
    assert _fits(document, schema())
    (tmp_path / 'ball.yaml').write_text(yaml.safe_dump(document))
    (contact,) = load_object(tmp_path / 'ball.yaml').contacts
    assert (contact.kind, contact.radius_m) == ('pin', 0.001)


def test_the_reference_page_has_the_table_of_the_schema():
    assert reference_table() in DOCS.read_text(encoding='utf-8')


def test_the_schema_is_printed(capsys):
    assert main(['--schema']) == 0
    assert json.loads(capsys.readouterr().out) == schema()


def test_a_shipped_object_is_copied_and_nothing_overwritten(tmp_path, capsys):
    assert main(['--copy', 'half_soda_can', '--out', str(tmp_path)]) == 0
    copied = load_object(tmp_path / 'half_soda_can.yaml')
    assert copied == load_object('half_soda_can')
    assert main(['--copy', 'half_soda_can', '--out', str(tmp_path)]) == 1
    assert main(['--copy', 'teapot', '--out', str(tmp_path)]) == 1
    errors = capsys.readouterr().err
    assert 'is there already' in errors and "no shipped object 'teapot'" in errors
