# SPDX-License-Identifier: Apache-2.0
"""Fingers placed in the page, and the real solver behind it."""

from __future__ import annotations

import io
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from scipy import ndimage
from sensor_msgs.msg import PointCloud2
from tests.chromium import new_tab
from tests.running import Running, own_domain, processes
from view_browser import buttons, choose, displacement_mm, enter, picture
from view_process import free_port, served

from grasp_view.messages import read_contacts, read_grasp, read_surface
from grasp_view.palette import LIGHT

CONTACTS = (PointCloud2, '/what_if/hand/contacts')
SURFACE = (PointCloud2, '/what_if/deformation/surface')
GRASP = (PointCloud2, '/what_if/deformation/grasp')
NONLINEAR = (PointCloud2, '/what_if/deformation/nonlinear')


@pytest.fixture(scope='module')
def domain() -> Iterator[int]:
    """The module's ROS domain."""
    with own_domain() as number:
        yield number


@pytest.fixture
def domain_id(domain: int) -> int:
    """Of every test here: that of the page."""
    return domain


@pytest.fixture(scope='module')
def address(
    domain: int, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[tuple[str, Running]]:
    """The page with its solver, for all tests of the module; it takes longest to start."""
    with processes(tmp_path_factory.mktemp('what_if')) as start:
        port = free_port()
        running = served(start, port, 'what_if:=true')
        yield f'http://127.0.0.1:{port}', running
        assert running.stop(signal.SIGINT) == 0, running.text
        assert 'Traceback' not in running.text


@pytest.fixture
def running(address: tuple[str, Running]) -> Running:
    """The page's process."""
    return address[1]


@pytest.fixture(scope='module')
def only_tab(browser: Any, address: tuple[str, Running]) -> Iterator[Any]:
    """The page in a tab that stays open."""
    opened = new_tab(browser, 1280, 860)
    opened.goto(address[0])
    yield opened
    opened.close()


@pytest.fixture
def tab(only_tab: Any, tmp_path: Path) -> Iterator[Any]:
    """That tab; a complaint in its console fails."""
    yield only_tab
    only_tab.screenshot(path=tmp_path / 'tab.png')
    assert only_tab.complaints == []


def largest_mm(message: PointCloud2 | None) -> float:
    moved = np.zeros((1, 3)) if message is None else read_surface(message).moved
    return 1e3 * float(np.linalg.norm(moved, axis=1).max())


def settled_mm(heard, wait_until, old: float, apart: float, log: Callable[[], str]) -> float:
    """The dent when ten surfaces in a row agree, `apart` (relative) from the old one.

    They must agree with the last equilibrium too: a background process that is late leaves its
    tangent standing.
    """
    messages: list[PointCloud2] = []
    last: list[float] = []

    def steady() -> bool:
        message = heard(*SURFACE)
        if message is not None and (not messages or message is not messages[-1]):
            messages.append(message)
            last.append(largest_mm(message))
        dents = np.array(last[-10:])
        same = len(dents) == 10 and np.ptp(dents) < 2e-3 * dents.max()
        solved = largest_mm(heard(*NONLINEAR))
        same = same and abs(dents[-1] - solved) < 1e-2 * dents[-1]
        return bool(same and abs(dents[-1] - old) > apart * old)

    wait_until(steady, 110, lambda: f'{last[-10:]}\n{log()}')
    return last[-1]


def test_an_unknown_object_is_one_sentence_and_exit_code_1(start, port: int) -> None:
    running = start(
        'grasp_view', '--ros-args', '-p', f'port:={port}', '-p', 'what_if:=true',
        '-p', 'object:=teapot',
    )  # fmt: skip
    assert running.ended() == 1
    assert 'teapot' in running.text and 'Traceback' not in running.text


def test_the_placed_fingers_are_answered_by_the_real_solver(running, heard, wait_until) -> None:
    wait_until(lambda: largest_mm(heard(*SURFACE)) > 0.5, 110, lambda: running.text)
    wait_until(lambda: heard(*CONTACTS), 30)
    sent = read_contacts(heard(*CONTACTS))
    assert np.allclose(sent.forces.sum(axis=0), 0.0, atol=0.05)
    assert np.allclose(np.linalg.norm(sent.points, axis=1), 0.0325, atol=2e-4)
    # Two pins face to face: the page's cones and words of closure come from this.
    wait_until(lambda: heard(*GRASP) is not None and read_grasp(heard(*GRASP)).closed, 60)


def handle(tab) -> np.ndarray:
    """Pixel (x, y) of the ball that is finger 1: the largest blue thing that is lit.

    The arrow of its force is as blue, and round where one looks along it, but has no shade.
    """
    tab.wait_for_timeout(150)
    shot = Image.open(io.BytesIO(tab.screenshot())).convert('RGB')
    picture = np.asarray(shot).astype(int)[:, 310:920]
    flat = np.abs(picture - LIGHT.finger(1)).max(axis=2) < 4
    red, _, blue = np.moveaxis(picture, 2, 0)
    # The lines of its friction cone cross it.
    whole = ndimage.binary_closing((blue > 90) & (red < 90) & (blue - red > 70), iterations=2)
    parts, _ = ndimage.label(whole)
    best, place = 100, np.full(2, np.nan)
    for k, (rows, columns) in enumerate(ndimage.find_objects(parts), 1):
        inside = np.argwhere(parts[rows, columns] == k)
        if len(inside) > best and flat[rows, columns][tuple(inside.T)].mean() < 0.5:
            best, middle = len(inside), inside.mean(axis=0)
            place = np.array([columns.start + middle[1] + 310, rows.start + middle[0]])
    return place


def pull(tab, wait_until, across: int, down: int) -> None:
    """Drag finger 1 over the picture by so many pixels, whatever the browser makes of the way."""
    seen = [np.full(2, np.nan)]

    def rests() -> bool:
        seen.append(handle(tab))
        return bool(np.linalg.norm(seen[-1] - seen[-2]) < 1.0)

    wait_until(rests, 60, lambda: f'{seen[-5:]}')
    start = seen[-1]
    there = start + [across, down]
    tab.mouse.move(*start)
    # The page draws before it knows what the pointer is over.
    taken = "[...document.querySelectorAll('canvas')].some(one => one.style.cursor == 'pointer')"
    wait_until(lambda: tab.evaluate(taken), 60, lambda: f'nothing to take at {start}')
    tab.mouse.down()
    tab.mouse.move(*(start + 0.2 * (there - start)))
    tab.mouse.move(*there)
    tab.mouse.up()
    # The ball stands off the surface, so it turns a little about the place that was pulled.
    wait_until(
        lambda: np.linalg.norm(handle(tab) - there) < 30.0,
        60,
        lambda: f'at {handle(tab)}, pulled from {start} to {there}',
    )


@pytest.mark.chromium
def test_a_finger_dragged_in_the_browser_takes_its_opposite_along_and_alone_opens_the_grasp(
    running, heard, tab, wait_until
) -> None:
    wait_until(lambda: np.isfinite(handle(tab)).all(), 110, lambda: running.text)

    def fingers() -> np.ndarray:
        """Where fingers 1 and 2 are now, (2, 3) m: behind the ten messages that may wait."""
        for _ in range(11):
            message = heard(*CONTACTS)
        return np.zeros((2, 3)) if message is None else read_contacts(message).points[:2]

    def says(words: str) -> None:
        """Wait until the page says of the grasp that it is `closed`, or `not closed`."""
        word = tab.locator('.grasp-hold b')
        wait_until(lambda: word.inner_text() == words, 60, word.inner_text)

    wait_until(lambda: np.allclose(fingers()[0], [0.0325, 0.0, 0.0], atol=1e-3), 60)
    pull(tab, wait_until, -120, -40)
    first, second = fingers()
    assert np.linalg.norm(first - [0.0325, 0.0, 0.0]) > 0.01
    assert np.allclose(second, -first, atol=2e-3)

    # Cones of 6 degrees hold a line that goes through the middle, no other.
    enter(tab, 'Friction', 0.1)
    opposed = tab.get_by_label('Opposed', exact=True)
    opposed.uncheck()
    tab.get_by_text('friction 0.10').wait_for(timeout=60_000)
    says('closed')
    pull(tab, wait_until, 70, 60)
    says('not closed')
    tab.get_by_text('more friction than there is').wait_for(timeout=60_000)
    assert np.allclose(fingers()[1], second, atol=2e-3)
    opposed.check()
    says('closed')
    first, second = fingers()
    assert np.allclose(second, -first, atol=2e-3)


@pytest.mark.chromium
def test_another_object_is_touched_at_its_own_places(running, heard, tab, wait_until) -> None:
    def away() -> float:
        """Of the farthest finger from the middle [m]."""
        message = heard(*CONTACTS)
        points = np.zeros((1, 3)) if message is None else read_contacts(message).points
        return float(np.linalg.norm(points, axis=1).max())

    for name, least, most in (('half_soda_can', 0.0329, 0.08), ('tennis_ball', 0.0322, 0.0328)):
        wait_until(lambda: 'Screenshot' in buttons(tab), 60)
        choose(tab, 'Object', name)
        wait_until(lambda low=least, high=most: low < away() < high, 60, lambda: running.text)


@pytest.mark.chromium
def test_force_modulus_theory_and_pressure_change_the_dent_as_physics_says(
    running, heard, tab, wait_until
) -> None:
    wait_until(lambda: 'Screenshot' in buttons(tab), 60)
    choose(tab, 'Theory', 'koiter')

    def dent(old: float, apart: float = 0.03) -> float:
        """The settled dent (mm), which the page shows too."""
        found = settled_mm(heard, wait_until, old, apart, lambda: running.text)
        wait_until(lambda: displacement_mm(tab) == pytest.approx(found, rel=0.01), 60)
        return found

    resting = dent(0.0)
    before = picture(tab)
    enter(tab, 'Finger 1 (N)', 2.0)
    soft = dent(resting)
    assert 0.3 < soft / resting < 0.42  # 2 N instead of 5 N, slightly softening

    enter(tab, 'Modulus (x file)', 2.0)
    stiff = dent(soft)
    assert stiff == pytest.approx(soft / 2, rel=0.1)

    enter(tab, 'Modulus (x file)', 1.0)
    assert dent(stiff) == pytest.approx(soft, rel=0.01)
    enter(tab, 'Finger 1 (N)', 15.0)
    koiter = dent(soft)
    # Beyond the snap of the cap a ball softens: more than in proportion to the force.
    assert koiter > 1.5 * (15.0 / 2.0) * soft
    wait_until(lambda: np.abs(picture(tab) - before).max() > 20, 60)

    choose(tab, 'Theory', 'paper')
    # The paper's strains are softer here (`shell_solve --theory paper --force 15`: 10 % deeper).
    paper = dent(koiter)
    assert paper == pytest.approx(1.1 * koiter, rel=0.04)

    enter(tab, 'Pressure (kPa)', 50.0)
    assert dent(paper) < 0.6 * paper
