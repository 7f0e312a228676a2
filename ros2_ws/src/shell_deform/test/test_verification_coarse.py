# SPDX-License-Identifier: Apache-2.0
"""Reference problems on meshes of a second: near the same references, within what so few give."""

import pytest

from shell_deform.verification import (
    capstan,
    closed_forms,
    friction,
    linear_course,
    plates,
    thick_exact,
    tubes,
)

COARSE = {
    'scordelis_lo': (lambda: [linear_course.scordelis_lo(10)], 0.004),
    'pinched_cylinder': (lambda: [linear_course.pinched_cylinder(16)], 0.05),
    'pinched_hemisphere': (lambda: [linear_course.pinched_hemisphere(4)], 0.05),
    'clamped_plate': (lambda: closed_forms.clamped_plate(6), 0.015),
    'slit_tube': (lambda: [closed_forms.slit_tube((16, 8))], 0.01),
    'tube_twisted': (lambda: tubes.twisted_tube(12, 20), 0.01),
    'supported_plate': (lambda: [thick_exact.supported_plate(0.1, 10)], 0.001),
    'thick_clamped_plate': (lambda: [thick_exact.clamped_plate(0.1, 12)], 0.03),
    'bent_block': (lambda: [thick_exact.bent_block(0.5)], 0.012),
    'blown_sphere': (lambda: thick_exact.blown_sphere(10.0, 60), 0.001),
    'strip_on_a_cylinder': (lambda: capstan.problems((24, 1), (0.3,)), 0.01),
    'plates_that_spin': (lambda: friction.spin(150), 0.001),
}
"""How it is solved, and how far that may be from the reference [-]."""


@pytest.mark.parametrize('name', COARSE)
def test_a_few_vertices_come_near_the_reference(name):
    solve, allowed = COARSE[name]
    rows = list(solve())
    assert rows
    assert [row.error for row in rows] == pytest.approx([0.0] * len(rows), abs=allowed)


def test_plates_are_scored_from_the_depth_on_where_the_wall_is_no_longer_crushed():
    wall = plates.kept_solution()['thickness_m']
    rows = list(plates.problems(250))
    depth = [1e-3 * float(row.quantity.split()[-2]) for row in rows]
    assert [row.goal is None for row in rows] == [one < 0.2 * wall for one in depth]
    assert [row.error for row in rows] == pytest.approx([0.0] * len(rows), abs=0.05)
