# SPDX-License-Identifier: Apache-2.0
"""The parts of the picture: where the hand, its pins, the forces and the surface are drawn."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import trimesh
from view_paper import server, visitor

from grasp_view import hand_layer
from grasp_view.force_layer import ForceLayer
from grasp_view.hand_description import Description, Joint, Visual
from grasp_view.hand_layer import HandLayer
from grasp_view.layer import SCALE
from grasp_view.palette import DARK, LIGHT
from grasp_view.poses import Pose, rotation_of
from grasp_view.probe import Probe, probe_html
from grasp_view.scene_model import DISPLACEMENT, Contacts, Mesh, Snapshot, Surface
from grasp_view.surface_layer import SurfaceLayer
from grasp_view.view_options import ViewOptions
from grasp_view.visitors import Visitor, Window

RADIUS = 0.03
BALL = trimesh.creation.icosphere(subdivisions=3, radius=RADIUS)
MESH = Mesh(np.asarray(BALL.faces), np.asarray(BALL.vertices))
OPTIONS = ViewOptions(DISPLACEMENT)


def dented(depth: float) -> Surface:
    """A ball whose +x side is pushed in, most at the pole; sigma a tenth of a millimetre."""
    height = np.maximum(MESH.rest[:, 0] / RADIUS, 0.0) ** 8
    moved = np.outer(-depth * height, [1.0, 0.0, 0.0])
    return Surface(1.0, 'object', MESH.rest + moved, moved, np.full(len(moved), 1e-4))


def pressed(newtons: float = 12.0, flags: int = 1) -> Contacts:
    return Contacts(
        1.0,
        'object',
        np.array([[RADIUS, 0.0, 0.0]]),
        np.array([[-1.0, 0.0, 0.0]]),
        np.array([[-newtons, 0.0, 0.0]]),
        np.array([0.25]),
        np.array([0.002]),
        np.array([1]),
        np.array([flags]),
    )


def bodies(glb: bytes) -> list[Any]:
    """The meshes of a file of bodies, in order."""
    return list(trimesh.load(io.BytesIO(glb), file_type='glb', process=False).geometry.values())


@pytest.fixture
def hand(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Description:
    """One link that turns about +z, 50 mm beside its base, with a cube of 10 mm for a mesh."""
    trimesh.creation.box((0.01, 0.01, 0.01)).export(tmp_path / 'cube.stl')
    monkeypatch.setattr(hand_layer, 'package_file', lambda _: tmp_path / 'cube.stl')
    beside = Pose(np.eye(3), np.array([0.05, 0.0, 0.0]))
    z = np.array([0.0, 0.0, 1.0])
    joint = Joint('turn', 'revolute', 'hand_base', 'finger_1_tip', beside, z, None)
    visual = Visual('finger_1_tip', 'package://any/cube.stl', Pose(), np.full(3, 2.0))
    return Description((visual,), (joint,))


def test_a_link_is_drawn_where_its_joint_turns_it(hand: Description) -> None:
    layer, one = HandLayer(), visitor()
    layer.draw(Snapshot(hand=hand, joints={'turn': np.pi / 2}), OPTIONS, [one])
    link = one.client.scene.things['/hand/0']
    assert np.ptp(link.given[0], axis=0) == pytest.approx([0.02 * SCALE] * 3)
    assert link.position == pytest.approx((0.05 * SCALE, 0.0, 0.0))
    assert link.wxyz == pytest.approx((np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)))
    layer.draw(Snapshot(hand=hand, joints={'turn': 0.0}), OPTIONS, [one])
    assert link.wxyz == pytest.approx((1.0, 0.0, 0.0, 0.0))
    assert one.client.scene.things == {'/hand/0': link}


def test_a_hand_that_is_not_wanted_is_out_of_sight_and_comes_back(hand: Description) -> None:
    layer, one = HandLayer(), visitor()
    snapshot = Snapshot(hand=hand, joints={'turn': 0.0})
    for wanted in (True, False, True):
        layer.draw(snapshot, ViewOptions(DISPLACEMENT, hand=wanted), [one])
        assert ('/hand/0' in one.client.scene.seen) == wanted


def test_a_pin_is_a_rod_from_the_fingertip_to_its_contact(hand: Description) -> None:
    layer, one = HandLayer(), visitor()
    joint = replace(hand.joints[0], parent='object')
    held = Snapshot(
        hand=replace(hand, joints=(joint,)),
        joints={'turn': 0.0},
        contacts=pressed(),
        served=dented(0.001),
        mesh=MESH,
        hand_frame='object',
    )
    layer.draw(held, OPTIONS, [one])
    pin = one.client.scene.things['/pin_1']
    assert pin.height == pytest.approx(0.02 * SCALE)
    assert pin.radius == pytest.approx(0.002 * SCALE)
    assert pin.position == pytest.approx((0.04 * SCALE, 0.0, 0.0))
    along = rotation_of(np.array(pin.wxyz)[[1, 2, 3, 0]])[:, 2]
    assert along == pytest.approx([-1.0, 0.0, 0.0], abs=1e-12)
    layer.draw(replace(held, contacts=None), OPTIONS, [one])
    assert '/pin_1' not in one.client.scene.seen


def test_an_arrow_and_a_label_stand_beside_the_finger_that_presses() -> None:
    layer, one = ForceLayer(), visitor()
    snapshot = Snapshot(mesh=MESH, served=dented(0.001), contacts=pressed())
    layer.draw(snapshot, OPTIONS, [one])
    scene = one.client.scene
    (arrow,) = bodies(scene.things['/force_1'].given[0])
    # Outside of the ball, its head at the smaller x: it points in.
    assert arrow.vertices[:, 0].min() > RADIUS * SCALE
    assert np.ptp(arrow.vertices[:, 0]) > np.ptp(arrow.vertices[:, 1])
    assert scene.things['/force_label_1'].text == 'F1  12.0 ± 0.2 N'
    assert {'/rest_halo', '/rest_ink'} <= scene.seen


def test_an_arrow_is_as_long_as_the_force_is_large() -> None:
    long = []
    for newtons in (8.0, 16.0):
        layer, one = ForceLayer(), visitor()
        layer.draw(
            Snapshot(mesh=MESH, served=dented(0.001), contacts=pressed(newtons)), OPTIONS, [one]
        )
        long.append(np.ptp(bodies(one.client.scene.things['/force_1'].given[0])[0].vertices[:, 0]))
    assert long[1] == pytest.approx(2.0 * long[0], rel=1e-5)


def test_the_dashes_of_the_rest_shape_lie_on_it_a_little_towards_the_finger() -> None:
    layer, one = ForceLayer(), visitor()
    layer.draw(Snapshot(mesh=MESH, served=dented(0.004), contacts=pressed()), OPTIONS, [one])
    points = one.client.scene.things['/rest_ink'].given[0].reshape(-1, 3) / SCALE
    off = np.linalg.norm(points, axis=1) - RADIUS
    assert len(points) > 20 and (np.abs(off) < 1e-3).all()


def test_forces_that_nobody_wants_to_see_or_feels_are_out_of_sight() -> None:
    layer, one = ForceLayer(), visitor()
    snapshot = Snapshot(mesh=MESH, served=dented(0.001), contacts=pressed())
    layer.draw(snapshot, OPTIONS, [one])
    layer.draw(snapshot, ViewOptions(DISPLACEMENT, contacts=False), [one])
    assert one.client.scene.seen == {'/rest_halo', '/rest_ink'}
    layer.draw(snapshot, ViewOptions(DISPLACEMENT, rest=False), [one])
    assert one.client.scene.seen == {'/force_1', '/force_label_1'}
    layer.draw(Snapshot(mesh=MESH, served=dented(0.001)), OPTIONS, [one])
    assert one.client.scene.seen == set()


def test_the_surface_is_drawn_as_it_stands_with_its_dent_as_often_as_it_is_exaggerated() -> None:
    for times in (1.0, 3.0):
        paper = server()
        layer = SurfaceLayer(paper)
        layer.draw(
            Snapshot(mesh=MESH, served=dented(0.004)),
            ViewOptions(DISPLACEMENT, exaggeration=times),
            [],
        )
        body, hull = bodies(paper.scene.things['/surface_0'].given[0])
        pole = body.vertices[np.abs(body.vertices[:, 1:]).max(axis=1) < 1e-6][:, 0]
        assert sorted(pole / SCALE) == pytest.approx([-RADIUS, RADIUS - times * 0.004], abs=2e-4)
        # The dark hull that outlines it is a little larger.
        assert 1.002 < np.ptp(hull.vertices[:, 1]) / np.ptp(body.vertices[:, 1]) < 1.02
        assert layer.legend is not None and layer.legend.largest == pytest.approx(4.0)
        assert layer.legend.low == 0.0 and 4.0 <= layer.legend.top <= 8.0


def test_lines_of_equal_displacement_stand_a_tenth_of_the_scale_apart() -> None:
    paper = server()
    layer = SurfaceLayer(paper)
    layer.draw(Snapshot(mesh=MESH, served=dented(0.004)), OPTIONS, [])
    assert layer.legend is not None
    assert layer.legend.line_step_m == pytest.approx(0.1 * 1e-3 * layer.legend.top)
    step = 1e3 * layer.legend.line_step_m
    assert f'every {step:g} mm, bold every {5 * step:g} mm' in layer.legend.note
    assert 'grey' not in layer.legend.note
    assert '/depth/ink_thin' in paper.scene.seen
    # The one bold line of that dent lies where the surface has moved by five steps.
    (bold,) = [name for name in paper.scene.seen if name.endswith('_bold')]
    moved = 5e-3 * step
    place = RADIUS * (moved / 0.004) ** (1.0 / 8.0) - moved
    there = paper.scene.things[bold].points.reshape(-1, 3) / SCALE
    assert there[:, 0] == pytest.approx(place, abs=6e-4)
    lines = paper.scene.things['/depth/ink_thin'].points.reshape(-1, 3) / SCALE
    assert (lines[:, 0] > 0.0).all()
    layer.draw(
        Snapshot(mesh=MESH, served=dented(0.004)), ViewOptions(DISPLACEMENT, depth_lines=False), []
    )
    assert layer.legend.line_step_m == 0.0
    assert not any(name.startswith('/depth') for name in paper.scene.seen)


def test_a_surface_is_sent_again_when_it_moved_by_more_than_a_pixel_and_turns_with_the_other() -> (
    None
):
    paper = server()
    layer = SurfaceLayer(paper)
    layer.draw(Snapshot(mesh=MESH, served=dented(0.004)), OPTIONS, [])
    assert paper.scene.seen >= {'/surface_0'} and '/surface_1' not in paper.scene.seen
    layer.draw(Snapshot(mesh=MESH, served=dented(0.004 + 1e-7)), OPTIONS, [])
    assert layer.drawn == 1
    still = Snapshot(mesh=MESH, served=dented(0.0045))
    layer.draw(still, OPTIONS, [])
    assert layer.drawn == 2
    assert '/surface_0' in paper.scene.seen and '/surface_1' not in paper.scene.seen
    layer.draw(still, OPTIONS, [])
    assert layer.drawn == 2
    assert '/surface_1' in paper.scene.seen and '/surface_0' not in paper.scene.seen


def test_without_an_answer_there_is_no_surface_no_scale_and_no_line() -> None:
    paper = server()
    layer = SurfaceLayer(paper)
    shown = ViewOptions(DISPLACEMENT, mesh_lines=True)
    layer.draw(Snapshot(mesh=MESH, served=dented(0.004)), shown, [])
    assert '/lines' in paper.scene.seen
    layer.draw(Snapshot(mesh=MESH), shown, [])
    assert layer.legend is None and paper.scene.seen == set()


def test_the_lines_of_the_mesh_go_with_the_surface_and_only_where_they_are_wanted() -> None:
    paper = server()
    layer = SurfaceLayer(paper)
    shown = ViewOptions(DISPLACEMENT, mesh_lines=True)
    layer.draw(Snapshot(mesh=MESH, served=dented(0.0)), shown, [])
    assert paper.scene.things['/lines'].given[0] == pytest.approx(MESH.rest * SCALE)
    moved = dented(0.004)
    for surface in (dented(0.002), moved):
        layer.draw(Snapshot(mesh=MESH, served=surface), shown, [])
    assert paper.scene.things['/lines'].vertices == pytest.approx(moved.position * SCALE, abs=1e-6)
    layer.draw(Snapshot(mesh=MESH, served=moved), OPTIONS, [])
    assert '/lines' not in paper.scene.seen


def tapped(paper: Any, origin: tuple[float, ...], direction: tuple[float, ...]) -> None:
    origin = tuple(SCALE * x for x in origin)
    paper.scene.clicked(SimpleNamespace(ray_origin=origin, ray_direction=direction))


def test_a_probe_reads_the_point_that_was_tapped_and_stays_with_its_material() -> None:
    paper = server()
    probe, layer = Probe(paper), SurfaceLayer(paper)
    snapshot = Snapshot(mesh=MESH, served=dented(0.004))
    assert probe.read(snapshot, OPTIONS, layer) is None
    tapped(paper, (0.2, 0.0, 0.0), (-1.0, 0.0, 0.0))
    found = probe.read(snapshot, OPTIONS, layer)
    assert found is not None
    assert found.value == pytest.approx(4.0, rel=0.05) and found.unit == 'mm'
    assert found.sigma == pytest.approx(0.1)
    assert found.place == pytest.approx([RADIUS - 0.004, 0.0, 0.0], abs=3e-4)
    assert paper.scene.things['/probe'].position == pytest.approx(found.place * SCALE)
    deeper = probe.read(Snapshot(mesh=MESH, served=dented(0.008)), OPTIONS, layer)
    assert deeper is not None and deeper.value == pytest.approx(2.0 * found.value)
    told = probe_html(found)
    assert '± 0.1' in told and 'x 26' in told and 'mm</p>' in told


def test_a_tap_beside_the_object_takes_the_probe_away() -> None:
    paper = server()
    probe, layer = Probe(paper), SurfaceLayer(paper)
    snapshot = Snapshot(mesh=MESH, served=dented(0.004))
    tapped(paper, (0.2, 0.0, 0.0), (-1.0, 0.0, 0.0))
    assert probe.read(snapshot, OPTIONS, layer) is not None
    tapped(paper, (0.2, 0.1, 0.0), (-1.0, 0.0, 0.0))
    assert probe.read(snapshot, OPTIONS, layer) is None
    assert '/probe' not in paper.scene.seen


@pytest.mark.parametrize('palette', [LIGHT, DARK])
def test_the_background_goes_from_one_colour_to_the_other(palette: Any) -> None:
    rows = palette.background()
    assert rows.shape == (64, 2, 3) and rows.dtype == np.uint8
    ends = [bytes.fromhex(text[1:]) for text in (palette.top, palette.bottom)]
    assert [bytes(rows[k, 1]) for k in (0, -1)] == ends
    middle = 0.5 * (np.array(list(ends[0])) + list(ends[1]))
    assert rows[31:33, 0].mean(axis=0) == pytest.approx(middle, abs=0.51)


@pytest.mark.parametrize(
    ('size', 'scene', 'phone', 'narrow'),
    [
        ((1440, 856), (1088, 644), False, False),
        ((1000, 640), (648, 428), False, False),
        ((999, 640), (647, 640), False, True),
        ((576, 800), (576, 432), True, True),
    ],
)
def test_the_panels_leave_the_scene_what_the_page_says(
    size: tuple[int, int], scene: tuple[int, int], phone: bool, narrow: bool
) -> None:
    window = Window(*size)
    assert (window.scene, window.phone, window.narrow) == (scene, phone, narrow)
    assert window.covered == pytest.approx(1.0 - scene[1] / size[1])


def test_the_picture_is_as_high_as_its_angle_opens_at_what_is_looked_at() -> None:
    one: Visitor = visitor()
    assert one.reach == pytest.approx(2.0 * 4.0 * np.tan(0.45))
    right, up, ahead = one.axes
    assert (right, up, ahead) == (
        pytest.approx([1.0, 0.0, 0.0]), pytest.approx([0.0, 0.0, 1.0]),
        pytest.approx([0.0, 1.0, 0.0]),
    )  # fmt: skip
