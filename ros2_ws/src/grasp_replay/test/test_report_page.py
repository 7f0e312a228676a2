# SPDX-License-Identifier: Apache-2.0
"""The report page: what stands in it, and what a real browser makes of it."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from markupsafe import Markup
from tests.legible import NAMELESS, TEXTS, worst_contrast

from grasp_replay.report import (
    Curve,
    LinearityTrace,
    PublishedRow,
    Report,
    ReportError,
    RowScene,
    Section,
    write_report,
)
from grasp_replay.report.errors import error_scales, nice_ceiling, scan_displacement, vertex_errors
from grasp_replay.report.numbering import numbered
from grasp_replay.report.section import cut, dent_section
from grasp_replay.report.write import _modulus, _unbeaten
from grasp_replay.results import published_lines

RADIUS = 0.0325
LBF = 4.4482216152605


def dented(points: np.ndarray, depth: float, width: float) -> np.ndarray:
    """Both poles of a sphere pushed in along x by `depth`, over an angle of `width` rad."""
    normal = points / np.linalg.norm(points, axis=1)[:, None]
    angle = np.arccos(np.clip(np.abs(normal[:, 0]), -1, 1))
    return points - normal * (depth * np.exp(-((angle / width) ** 2)))[:, None]


def ball_row(key: str, force_lbf: float, depth: float, seed: int = 1) -> RowScene:
    sphere = trimesh.creation.icosphere(subdivisions=4, radius=RADIUS)
    vertices = np.asarray(sphere.vertices)
    generator = np.random.default_rng(seed)
    normal = generator.normal(size=(20000, 3))
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    normal = normal[(np.abs(normal[:, 0]) < 0.995) & (normal[:, 2] > -0.5)]
    noise = generator.normal(scale=0.127e-3, size=len(normal))
    scan = dented(normal * RADIUS, depth, 0.35) + normal * noise[:, None]

    def error(shape_depth: float, width: float) -> np.ndarray:
        model = dented(normal * RADIUS, shape_depth, width)
        return np.einsum('ij,ij->i', scan - model, normal)

    force = force_lbf * LBF
    return RowScene(
        key=key,
        title=f'ball, {force_lbf} lbf per finger',
        kind='synthetic',
        force_n=force,
        triangles=np.asarray(sphere.faces),
        rest=vertices,
        nonlinear=dented(vertices, 0.95 * depth, 0.35),
        linear=dented(vertices, 0.6 * depth, 0.3),
        scan_points=scan,
        nonlinear_error=error(0.95 * depth, 0.35),
        linear_error=error(0.6 * depth, 0.3),
        scan_displacement=RADIUS - np.linalg.norm(scan, axis=1),
        contact_points=np.array([[RADIUS - depth, 0, 0], [depth - RADIUS, 0, 0]]),
        contact_forces=np.array([[-force, 0, 0], [force, 0, 0]]),
        noise_floor_m=0.101e-3,
    )


ROWS = [('row_1', 2.39, 2.56e-3), ('row_2', 4.83, 10.27e-3)]


@pytest.fixture(scope='module')
def scenes() -> list[RowScene]:
    return [ball_row(*row) for row in ROWS]


@pytest.fixture(scope='module')
def results(scenes: list[RowScene]) -> dict:
    def statistics(errors: np.ndarray, depth: float) -> dict:
        size = np.abs(errors)
        return {
            'mean_error_m': float(size.mean()),
            'rms_error_m': float(np.sqrt((size**2).mean())),
            'p95_error_m': float(np.percentile(size, 95)),
            'max_error_m': 0.9 * float(np.percentile(size, 95)),
            'raw_max_error_m': float(size.max()),
            'dent_mean_error_m': float(size.mean()),
            'max_displacement_m': depth,
        }

    return {
        'bag_sha256': 'ab' * 32,
        'young_modulus_pa': 13.47e6,
        'rows': [
            {
                'force_n': scene.force_n,
                'measured_max_displacement_m': depth,
                'noise_floor_m': scene.noise_floor_m,
                'theories': {
                    'linear': statistics(scene.linear_error, 0.6 * depth),
                    'koiter': statistics(scene.nonlinear_error, 0.95 * depth),
                },
            }
            for scene, (_, _, depth) in zip(scenes, ROWS, strict=True)
        ],
    }


KOITER, LINEAR = 'koiter, E 12.75 MPa', 'linear with its own E 8.27 MPa, from row 1'
PUBLISHED = [
    PublishedRow(
        'tennis ball', 2.39, 2.56e-3, 0.31e-3, 0.30e-3, {KOITER: 2.6e-3, LINEAR: 2.56e-3}
    ),
    PublishedRow(
        'tennis ball', 3.71, 6.05e-3, 0.62e-3, 0.85e-3, {KOITER: 6.1e-3, LINEAR: 3.97e-3}
    ),
]
PROVENANCE = {
    'title': 'tennis ball, two fingers',
    'synthetic': 'shapes by a solid model, scanner errors added.',
    'bag': {'sha256': 'ab' * 32},
    'versions': {'numpy': np.__version__},
}


@pytest.fixture(scope='module')
def page(tmp_path_factory: pytest.TempPathFactory, scenes: list[RowScene], results: dict) -> Path:
    time = np.linspace(0, 30, 200)
    report = Report(
        results,
        scenes,
        PROVENANCE,
        published=PUBLISHED,
        published_in={'authors': 'A. Author', 'year': 2009, 'title': 'Shells', 'doi': '10.1/x'},
        curves=[
            Curve(
                'Table I',
                'published',
                np.array([2.56e-3, 6.05e-3]),
                np.array([10.6, 16.5]),
                displacement_band_m=0.127e-3,
            ),
            Curve(
                'koiter',
                'predicted',
                np.array([0, 3e-3, 7e-3]),
                np.array([0, 11.0, 17.0]),
                lower_n=np.array([0, 10.0, 16.0]),
                upper_n=np.array([0, 12.0, 18.0]),
            ),
        ],
        linearity=LinearityTrace(time, np.abs(np.sin(time)) * 0.3, np.abs(np.sin(time)) * 5e-3),
        timings={'koiter': 1.234},
    )
    return write_report(report, tmp_path_factory.mktemp('report'))


def test_published_and_our_numbers_stand_in_differently_marked_cells(page: Path) -> None:
    text = page.read_text()
    assert '<td class="published">0.31</td>' in text
    assert re.search(r'<td class="synthetic( best)?">\d\.\d{3}</td>', text)
    assert 'this recording (synthetic)' in text and 'shapes by a solid model' in text


def test_the_models_stand_first_each_with_its_modulus(page: Path) -> None:
    text = page.read_text()
    assert text.index('id="published-models"') < text.index('id="comparison"')
    table = text[text.index('id="published-models"') : text.index('id="comparison"')]
    for name in (KOITER, LINEAR):
        assert f'<td class="left predicted">{name}</td>' in table
    assert '<td class="predicted">3.97 (-34 %)</td>' in table
    heads = re.findall(r'<caption>.*?</caption>', text, re.DOTALL)
    assert sum('E 13.47 MPa' in head for head in heads) == 2


def test_theory_thick_is_named_with_the_modulus_of_its_own(results: dict) -> None:
    assert _modulus(results) == 'E 13.47 MPa'
    solid = {**results, 'solid_young_modulus_pa': 14.15e6}
    assert _modulus(solid) == 'E 13.47 MPa'
    told = {'mean_error_m': 1e-4}
    rows = [{'theories': {**row['theories'], 'thick': told}} for row in results['rows']]
    assert _modulus({**solid, 'rows': rows}) == 'E 13.47 MPa (thick: 14.15 MPa)'


def test_the_paper_is_cited_and_tables_and_figures_are_numbered(page: Path) -> None:
    text = page.read_text()
    assert 'A. Author (2009) <a href="#reference">[1]</a>' in text
    assert '[1] A. Author (2009). <cite>Shells</cite>. doi:10.1/x' in ' '.join(text.split())
    for what, count in (('Figure', 7), ('Table', 3)):
        found = [int(number) for number in re.findall(rf'<b>{what} (\d+)\.</b>', text)]
        assert found == list(range(1, count + 1)), (what, found)


def test_captions_of_other_modules_are_counted_and_those_of_controls_are_not() -> None:
    text = '<figcaption>a</figcaption><figcaption class="how">b</figcaption><figcaption>c'
    assert numbered(text + '<caption>d') == (
        '<figcaption><b>Figure 1.</b> a</figcaption><figcaption class="how">b</figcaption>'
        '<figcaption><b>Figure 2.</b> c<caption><b>Table 1.</b> d'
    )


def test_every_statistic_says_what_it_is(page: Path) -> None:
    text = page.read_text()
    heads = re.findall(r'<th>([^<]+) \(mm\)</th>', text)
    assert 'largest mean over a disc of 2 mm' in heads and 'largest single point' in heads
    assert 'max' not in heads


def test_published_errors_are_drawn_beside_ours(page: Path) -> None:
    text = page.read_text()
    assert text.index('id="errors"') < text.index('id="row-by-row"')
    assert 'filled and\ndotted' in text


def test_a_published_row_that_was_not_recorded_is_kept_with_dashes(page: Path) -> None:
    line = next(part for part in page.read_text().split('<tr>') if '>3.71</td>' in part)
    assert '6.05' in line and '<td class="synthetic">–</td>' in line


def test_a_difference_within_the_noise_floor_is_not_made_bold(
    tmp_path: Path, scenes: list[RowScene], results: dict
) -> None:
    text = write_report(Report(results, scenes, {}), tmp_path).read_text()
    first, second = (
        next(part for part in text.split('<tr>') if f'>{scene.force_n:.2f}</td>' in part)
        for scene in scenes
    )
    assert 'best' not in first and second.count('best') == 1


def test_the_best_are_those_that_none_undercuts_by_more_than_the_floor() -> None:
    assert _unbeaten([0.10, 0.12, None, 0.2], 0.03) == {0, 1}
    assert _unbeaten([0.10, 0.12, 0.2], 0.01) == {0}
    assert _unbeaten([0.10, 0.12], 0.03) == set()


def test_verdicts_stand_under_the_table(tmp_path: Path, results: dict) -> None:
    rows = [{**row, 'verdict': 'no verdict: within the floor'} for row in results['rows']]
    text = write_report(Report({**results, 'rows': rows}, [], {}), tmp_path).read_text()
    assert text.count('no verdict: within the floor') == 2


def test_the_page_asks_the_network_for_nothing_and_is_small(page: Path) -> None:
    text = page.read_text()
    links = re.findall(r'(?:src|href)\s*=\s*"(?!data:|#)([^"]+)"', text)
    assert links == []
    assert 'url(http' not in text and '@import' not in text
    assert page.stat().st_size < 5e6


def test_the_same_input_gives_the_same_bytes(
    page: Path, tmp_path: Path, scenes: list[RowScene], results: dict
) -> None:
    first = write_report(Report(results, scenes, PROVENANCE), tmp_path / 'a')
    second = write_report(Report(results, scenes, PROVENANCE), tmp_path / 'b')
    assert first.read_bytes() == second.read_bytes()
    for scene in scenes:
        name = f'pictures/{scene.key}.png'
        assert (tmp_path / 'a' / name).read_bytes() == (tmp_path / 'b' / name).read_bytes()


def test_text_from_outside_is_escaped(
    tmp_path: Path, scenes: list[RowScene], results: dict
) -> None:
    row = replace(scenes[0], title='<script>alert(1)</script>')
    one = {**results, 'rows': results['rows'][:1]}
    path = write_report(Report(one, [row], {'note': '</script><b>'}), tmp_path)
    text = path.read_text()
    assert '<script>alert' not in text and '</script><b>' not in text


def test_a_section_of_another_module_stands_between_table_and_rows(
    tmp_path: Path, results: dict
) -> None:
    section = Section('other', 'R & D', Markup('<p>made elsewhere</p>'))
    text = write_report(Report(results, [], {}, sections=[section]), tmp_path).read_text()
    assert '<h2 id="other">R &amp; D</h2>\n<p>made elsewhere</p>' in text
    assert text.index('id="comparison"') < text.index('id="other"') < text.index('row-by-row')


def test_a_report_without_shapes_still_has_its_table(tmp_path: Path, results: dict) -> None:
    text = write_report(Report(results, [], {}), tmp_path).read_text()
    assert 'id="comparison"' in text


def test_a_theory_that_was_left_out_is_left_out_of_the_errors(
    tmp_path: Path, results: dict
) -> None:
    rows = [
        {**row, 'theories': {**row['theories'], 'thick': {'mean_error_m': None}}}
        for row in results['rows']
    ]
    path = write_report(Report({**results, 'rows': rows}, [], {'object': 'ball'}), tmp_path)
    assert 'koiter mean error' in path.read_text()


def test_one_scene_too_few_is_refused(
    tmp_path: Path, scenes: list[RowScene], results: dict
) -> None:
    with pytest.raises(ReportError, match='1 scenes for 2 rows'):
        write_report(Report(results, scenes[:1], {}), tmp_path)


@pytest.mark.parametrize(
    ('change', 'message'),
    [
        ({'key': '../evil'}, 'letters'),
        ({'kind': 'invented'}, 'invented'),
        ({'triangles': np.array([[0, 1, 99999]])}, '0..2561'),
        ({'linear': np.zeros((3, 3))}, '3 vertices'),
        ({'linear_error': np.zeros(5)}, '5 values'),
        ({'rest': np.full((2562, 3), np.nan)}, 'NaN'),
        ({'contact_forces': np.zeros((1, 3))}, '1 forces'),
    ],
)
def test_a_row_that_does_not_fit_is_refused_by_name(
    scenes: list[RowScene], change: dict, message: str
) -> None:
    with pytest.raises(ReportError, match=message) as caught:
        replace(scenes[0], **change)
    assert 'row' in str(caught.value)


def test_each_theory_has_one_round_error_scale_for_all_rows(scenes: list[RowScene]) -> None:
    tops = error_scales(scenes)
    assert np.percentile(np.abs(scenes[1].linear_error), 95) <= tops.linear <= 5e-3
    assert np.percentile(np.abs(scenes[1].nonlinear_error), 95) <= tops.nonlinear
    assert tops.nonlinear < 0.5 * tops.linear
    assert (
        nice_ceiling(0.41) == pytest.approx(0.5)
        and nice_ceiling(10.0) == 10.0
        and nice_ceiling(0.0) == 1.0
    )


def test_vertices_the_scanner_did_not_see_have_no_error(scenes: list[RowScene]) -> None:
    row = scenes[0]
    values = vertex_errors(row.nonlinear, row.scan_points, row.nonlinear_error, 1.5e-3)
    below = row.rest[:, 2] < -0.75 * RADIUS
    assert np.isnan(values[below]).all() and np.isfinite(values[row.rest[:, 2] > 0]).mean() > 0.9


def test_the_scans_displacement_is_estimated_where_it_is_not_given(
    scenes: list[RowScene],
) -> None:
    estimated = scan_displacement(replace(scenes[1], scan_displacement=None))
    assert np.abs(estimated - scenes[1].scan_displacement).max() < 0.15e-3


def test_a_plane_cuts_a_sphere_in_a_circle() -> None:
    sphere = trimesh.creation.icosphere(subdivisions=3, radius=1.0)
    segments = cut(
        np.asarray(sphere.vertices),
        np.asarray(sphere.faces, dtype=np.int32),
        np.array([0.0, 0.0, 1.0]),
        0.5,
    )
    assert np.allclose(segments[..., 2], 0.5)
    length = np.linalg.norm(segments[:, 0] - segments[:, 1], axis=1).sum()
    assert length == pytest.approx(2 * np.pi * np.sqrt(0.75), rel=0.01)


def test_a_plane_through_vertices_cuts_once() -> None:
    sphere = trimesh.creation.icosphere(subdivisions=3, radius=1.0)
    segments = cut(
        np.asarray(sphere.vertices),
        np.asarray(sphere.faces, dtype=np.int32),
        np.array([0.0, 0.0, 1.0]),
        0.0,
    )
    length = np.linalg.norm(segments[:, 0] - segments[:, 1], axis=1).sum()
    assert length == pytest.approx(2 * np.pi, rel=0.01)


def test_the_dent_section_counts_from_the_rest_face(scenes: list[RowScene]) -> None:
    section = dent_section(scenes[1])
    assert section.rest[..., 1].max() == pytest.approx(0.0, abs=2e-4)
    middle = np.abs(section.nonlinear[..., 0]) < 1.5e-3
    upper = section.nonlinear[..., 1][middle & (section.nonlinear[..., 1] > -RADIUS)]
    assert upper.min() == pytest.approx(-0.95 * ROWS[1][2], abs=3e-4)


@pytest.mark.chromium
def test_a_browser_shows_the_rows_turnable(open_tab, page: Path, wait_until) -> None:
    tab = open_tab(1200, 900)
    tab.goto(page.as_uri())
    tab.wait_for_selector('body.webgl')
    canvas = tab.locator('#turn-row_2 canvas')
    canvas.scroll_into_view_if_needed()
    before = canvas.screenshot()
    box = canvas.bounding_box()
    assert box is not None
    x, y = box['x'] + box['width'] / 2, box['y'] + box['height'] / 2
    tab.mouse.move(x, y)
    tab.mouse.down()
    tab.mouse.move(x + 80, y + 30)
    tab.mouse.up()
    wait_until(lambda: canvas.screenshot() != before, 60)
    top = tab.locator('#turn-row_2 .top')
    assert top.inner_text() == f'{0.95 * ROWS[1][2] * 1e3:.2f} mm'
    tab.locator('#turn-row_2 select[name=colour]').select_option('error')
    packed = json.loads(tab.locator('#rows').inner_text())
    wanted = f'{packed[1]["errorTop"]["nonlinear"] * 1e3:.2f} mm'
    wait_until(lambda: top.inner_text() == wanted, 60)


@pytest.mark.chromium
def test_a_phone_does_not_scroll_sideways(open_tab, page: Path) -> None:
    tab = open_tab(390, 800)
    tab.goto(page.as_uri())
    assert tab.evaluate('document.documentElement.scrollWidth') <= 390


@pytest.mark.chromium
@pytest.mark.parametrize(
    ('scheme', 'ground'), [('light', (255, 255, 255)), ('dark', (21, 27, 34))]
)
def test_text_stands_out_controls_have_names_and_nothing_is_fetched(
    open_tab, page: Path, scheme: str, ground: tuple[int, int, int]
) -> None:
    tab = open_tab(1200, 900, color_scheme=scheme)
    tab.goto(page.as_uri())
    tab.wait_for_selector('body.webgl')
    texts = tab.evaluate(TEXTS)
    assert len(texts) > 50
    assert [one for one in worst_contrast(texts, ground) if one[0] < 4.5] == []
    assert [(one['text'], one['size']) for one in texts if one['size'] < 11] == []
    assert tab.evaluate(NAMELESS) == []
    assert tab.evaluate('document.documentElement.lang') == 'en'
    without = "() => [...document.querySelectorAll('img')].filter(e => !e.alt).length"
    assert tab.evaluate(without) == 0
    assert tab.complaints == []
    assert [url for url in tab.asked if not url.startswith(('file:', 'data:', 'blob:'))] == []


@pytest.mark.chromium
def test_the_whole_table_is_on_a_printed_sheet(open_tab, page: Path) -> None:
    # A4 less one centimetre on both sides, in CSS pixels.
    tab = open_tab(718, 1050)
    tab.goto(page.as_uri())
    tab.emulate_media(media='print')
    for table in ('#comparison', '#published-models'):
        box = tab.locator(table).bounding_box()
        assert box is not None and box['x'] >= 0.0 and box['x'] + box['width'] <= 718


@pytest.mark.chromium
def test_printing_gives_pages_with_the_pictures(open_tab, page: Path) -> None:
    tab = open_tab(1200, 900)
    tab.goto(page.as_uri())
    tab.emulate_media(media='print')
    assert not tab.locator('#turn-row_1').is_visible()
    assert tab.locator('img').first.is_visible()
    assert tab.pdf(format='A4').startswith(b'%PDF')


@pytest.mark.chromium
def test_dark_screens_get_a_dark_page_and_paper_stays_white(open_tab, page: Path) -> None:
    tab = open_tab(1200, 900, color_scheme='dark')
    tab.goto(page.as_uri())
    ground = 'getComputedStyle(document.body).backgroundColor'
    assert tab.evaluate(ground) == 'rgb(21, 27, 34)' and tab.complaints == []
    tab.emulate_media(media='print')
    assert tab.evaluate(ground) == 'rgb(255, 255, 255)'


@pytest.mark.chromium
def test_no_figure_is_torn_from_its_heading_in_print(open_tab, page: Path) -> None:
    # A4 less the margins that the page asks for, in CSS pixels.
    tab = open_tab(695, 1031)
    tab.goto(page.as_uri())
    tab.emulate_media(media='print')
    rules = tab.evaluate(
        """() => [...document.querySelectorAll('section, figure, .pair')]
          .map(e => getComputedStyle(e).breakInside)"""
    )
    assert rules and set(rules) == {'avoid'}
    heights = tab.evaluate(
        """() => [...document.querySelectorAll('section')]
          .map(e => e.getBoundingClientRect().height)"""
    )
    # Two rows a page: A4 less 12 mm above and below, and the heading before them.
    assert 2 * max(heights) + 45 < 273 / 25.4 * 96


def test_every_prediction_names_the_modulus_it_was_made_with() -> None:
    predicted = {'linear': 1.661e-3, 'koiter': 2.560e-3, 'thick': 2.582e-3}
    row = {
        'force_n': 10.631,
        'measured_max_displacement_m': 2.56e-3,
        'young_modulus_pa': 12.75e6,
        'solid_young_modulus_pa': 13.79e6,
        'predicted_max_displacement_m': predicted,
    }
    heading, line = published_lines({'published': [row]})
    assert dict(zip(heading[2:], line[2:], strict=True)) == {
        'linear, E 12.75 MPa': '1.661',
        'koiter, E 12.75 MPa': '2.560',
        'thick, E 13.79 MPa': '2.582',
        'linear with its own E 8.27 MPa, from row 1': '2.560',
    }
