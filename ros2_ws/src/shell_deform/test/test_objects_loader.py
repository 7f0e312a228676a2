# SPDX-License-Identifier: Apache-2.0
"""Object files are read strictly: every complaint names file and line."""

from pathlib import Path

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from shell_deform.objects import ObjectError, edge_names, load_object, object_names

GOOD = """\
name: jar
surface:
  cylinder: {outer_diameter_m: 0.08, length_m: 0.1, ends: closed}
thickness_m: 0.001
young_modulus_pa: 2.0e+9
poisson_ratio: 0.4
yield_stress_pa: 5.0e+7
gas: {kind: sealed, gauge_pressure_pa: 1000.0, ambient_pa: 100000.0}
supports:
  - {kind: held, where: z=-0.05}
contacts:
  - {at_m: [0.04, 0.0, 0.0], radius_m: 0.003, kind: pad}
control_vertices: 500
source: measured
"""


def load(tmp_path: Path, text: str):
    path = tmp_path / 'jar.yaml'
    path.write_text(text)
    return load_object(path)


def test_every_field_of_a_file_is_read(tmp_path):
    jar = load(tmp_path, GOOD)
    assert jar.name == 'jar'
    assert (jar.surface.kind, jar.surface.outer_diameter_m) == ('cylinder', 0.08)
    assert (jar.thickness_m, jar.young_modulus_pa, jar.poisson_ratio) == (0.001, 2e9, 0.4)
    assert jar.yield_stress_pa == 5e7
    assert (jar.gas.kind, jar.gas.gauge_pressure_pa, jar.gas.ambient_pa) == ('sealed', 1e3, 1e5)
    assert jar.supports[0].where == 'z=-0.05'
    assert jar.contacts[0].at_m == (0.04, 0.0, 0.0)
    assert jar.control_vertices == 500
    assert jar.source == 'measured'


@pytest.mark.parametrize(
    ('old', 'new', 'message'),
    [
        ('thickness_m: 0.001', 'thickness: 0.001', "line 4: .* no key 'thickness': say the unit"),
        ('thickness_m: 0.001\n', '', 'line 1: the object lacks thickness_m'),
        ('thickness_m: 0.001', 'thickness_m: 1 mm', "line 4: thickness_m is '1 mm'; a plain num"),
        ('thickness_m: 0.001', 'thickness_m: -1', 'line 4: thickness_m is -1; it must be above 0'),
        ('thickness_m: 0.001', 'thickness_m: nan', 'line 4: thickness_m is nan; a finite number'),
        ('thickness_m: 0.001', 'thickness_m: 0.05', 'line 4: .* smallest outer radius 0.04'),
        ('thickness_m: 0.001', 'thickness_m: [1, 2]', 'line 4: a thickness per vertex needs'),
        ('ratio: 0.4', 'ratio: 0.51', 'line 6: poisson_ratio is 0.51; the largest .* is 0.5'),
        ('ratio: 0.4', 'ratio: -1.0', 'line 6: poisson_ratio is -1.0; it must be above -1'),
        ('length_m: 0.1', 'lenght_m: 0.1', 'line 3: .*did you mean length_m'),
        ('ends: closed', 'ends: round', "line 3: ends is 'round'; allowed are open, closed"),
        ('ends: closed', 'ends: open', 'line 8: an open cylinder cannot hold sealed gas'),
        ('kind: sealed', 'kind: none', 'line 8: gauge_pressure_pa needs kind: sealed'),
        ('1000.0', '-200000.0', 'line 8: gauge_pressure_pa is -200000.0; the smallest'),
        ('where: z=-0.05', 'where: boundary', 'line 10: a closed cylinder has no boundary'),
        ('where: z=-0.05', 'where: z=low', "line 10: where is 'z=low'; allowed are boundary, or"),
        ('kind: held', 'kind: glued', "line 10: kind is 'glued'; allowed are clamped"),
        ('[0.04, 0.0, 0.0]', '[0.04, 0.0]', r'line 12: at_m has 2 values; 3 are needed'),
        ('control_vertices: 500', 'control_vertices: 0.5', 'line 13: control_vertices is 0.5'),
        ('control_vertices: 500', 'control_vertices: 20.5', 'line 13: .*a whole number'),
        ('source: measured', 'name: again', 'line 14: name is given twice'),
        ('cylinder: {', 'cube: {', "line 3: surface has no key 'cube'; allowed are sphere"),
        ('surface:\n', 'surface: [', 'not YAML'),
    ],
)
def test_a_wrong_file_is_refused_with_its_line(tmp_path, old, new, message):
    assert old in GOOD
    with pytest.raises(ObjectError, match=message) as caught:
        load(tmp_path, GOOD.replace(old, new))
    assert 'jar.yaml' in str(caught.value)


def test_unreadable_files_are_refused(tmp_path):
    with pytest.raises(ObjectError, match='the file is empty'):
        load(tmp_path, '')
    (tmp_path / 'jar.yaml').write_bytes(bytes([0xFF, 0xFE, 0x00]))
    with pytest.raises(ObjectError, match='not a text file'):
        load_object(tmp_path / 'jar.yaml')
    with pytest.raises(ObjectError, match="no object file 'teapot'; the shipped objects are half"):
        load_object('teapot')


def test_profiles_touch_the_axis_only_at_their_ends(tmp_path):
    old = 'cylinder: {outer_diameter_m: 0.08, length_m: 0.1, ends: closed}'
    for profile, message in (
        ('[[0.0, 0.0], [0.0, 0.1], [0.1, 0.1]]', 'radius is zero inside the profile'),
        ('[[0.1, 0.0], [0.1, 0.0]]', 'repeats the one before'),
        ('[[0.1, 0.0]]', 'at least two are needed'),
    ):
        with pytest.raises(ObjectError, match=f'line 3: .*{message}'):
            load(tmp_path, GOOD.replace(old, f'revolution: {{outer_profile_m: {profile}}}'))


def test_files_are_found_beside_the_object_file(tmp_path):
    (tmp_path / 'field.csv').write_text('0,0,0\n0,1,0\n0,0,0\n')
    text = GOOD.replace(
        'cylinder: {outer_diameter_m: 0.08, length_m: 0.1, ends: closed}',
        'height_field: {file: field.csv, spacing_m: 0.01}',
    ).replace('gas: {kind: sealed, gauge_pressure_pa: 1000.0, ambient_pa: 100000.0}\n', '')
    assert load(tmp_path, text).surface.file == (tmp_path / 'field.csv').resolve()
    with pytest.raises(ObjectError, match='line 3: there is no file .*other.csv'):
        load(tmp_path, text.replace('field.csv', 'other.csv'))


def test_the_shipped_objects():
    assert object_names() == ['half_soda_can', 'tennis_ball', 'tennis_ball_as_printed']
    ball, printed = load_object('tennis_ball'), load_object('tennis_ball_as_printed')
    can = load_object('half_soda_can')
    assert (ball.surface.outer_diameter_m, ball.thickness_m) == (0.065, 0.0025)
    assert (ball.young_modulus_pa, ball.poisson_ratio) == (12.75e6, 0.5)
    assert (ball.gas.kind, ball.gas.gauge_pressure_pa, ball.gas.ambient_pa) == (
        'sealed',
        0.0,
        101_325.0,
    )
    assert {contact.radius_m for contact in ball.contacts} == {0.001}
    assert (printed.young_modulus_pa, printed.gas.kind) == (1e6, 'none')
    assert {contact.radius_m for contact in printed.contacts} == {0.002}
    assert (can.surface.outer_diameter_m, can.thickness_m) == (0.066, 0.0001)
    assert [(support.kind, support.where) for support in can.supports] == [('hinged', 'straight')]
    assert edge_names(can.surface) == ('straight', 'ends')


@given(text=st.text(max_size=200))
@settings(max_examples=150, deadline=None)
def test_any_text_gives_an_object_or_an_object_error(text, tmp_path_factory):
    path = tmp_path_factory.getbasetemp() / 'any.yaml'
    path.write_text(text, encoding='utf-8', errors='replace')
    with pytest.raises(ObjectError):
        load_object(path)


JSON_LIKE = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3)
    ),
    max_leaves=8,
)


@given(key=st.sampled_from(sorted(yaml.safe_load(GOOD))), value=JSON_LIKE)
@settings(max_examples=150, deadline=None)
def test_any_value_of_any_key_gives_an_object_or_an_object_error(key, value, tmp_path_factory):
    content = yaml.safe_load(GOOD) | {key: value}
    path = tmp_path_factory.getbasetemp() / 'any.yaml'
    path.write_text(yaml.safe_dump(content), encoding='utf-8')
    try:
        load_object(path)
    except ObjectError as error:
        assert str(path) in str(error)


RELAXING = GOOD + 'relaxation: {kind: log, share_per_decade: 0.03, from_s: 0.1, to_s: 1000}\n'


def test_a_relaxation_is_read_in_both_of_its_forms(tmp_path):
    law = load(tmp_path, RELAXING).relaxation
    assert (law.per_decade, law.first, law.last, law.reference) == (0.03, 0.1, 1000.0, 0.1)
    terms = 'relaxation: {kind: prony, shares: [0.1, 0.2], times_s: [1, 10]}\n'
    law = load(tmp_path, GOOD + terms).relaxation
    assert law.terms == ((0.1, 1.0), (0.2, 10.0))


@pytest.mark.parametrize(
    ('old', 'new', 'message'),
    [
        ('0.03', '-0.03', 'line 15: relaxation: .* grows'),
        ('to_s: 1000', 'to_s: 0.01', 'line 15: relaxation: the times run back'),
        (', to_s: 1000', '', 'line 15: relaxation of kind log lacks to_s'),
        ('to_s', 'to', "line 15: relaxation has no key 'to'"),
        ('kind: log', 'kind: prony', 'line 15: relaxation of kind prony lacks shares, times_s'),
        ('to_s: 1000', 'to_s: 1000, shares: [0.1]', 'shares does not belong to .* kind log'),
        ('0.03', 'much', "line 15: share_per_decade is 'much'; a plain number"),
        ('to_s: 1000', 'to_s: .inf', "line 15: to_s is '.inf'; a"),
    ],
)
def test_a_relaxation_that_cannot_be_is_refused_with_its_line(tmp_path, old, new, message):
    with pytest.raises(ObjectError, match=message):
        load(tmp_path, RELAXING.replace(old, new))


def test_a_folder_with_one_object_file_is_taken_for_it(tmp_path):
    with pytest.raises(ObjectError, match='holds no .yaml file: name the object file'):
        load_object(tmp_path)
    load(tmp_path, GOOD)
    assert load_object(tmp_path).name == load_object(tmp_path / 'jar.yaml').name
    (tmp_path / 'other.yaml').write_text('')
    with pytest.raises(ObjectError, match=r'holds jar\.yaml, other\.yaml: name the object file'):
        load_object(tmp_path)
    # A recording has more files than its object.
    (tmp_path / 'object.yaml').write_text(GOOD)
    assert load_object(str(tmp_path)).name == load_object(tmp_path / 'jar.yaml').name
