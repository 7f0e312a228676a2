# SPDX-License-Identifier: Apache-2.0
"""Whether the grasp holds: `deformation/grasp` in words, and the squeeze window as a bar."""

from __future__ import annotations

import html
from dataclasses import dataclass

from .palette import DARK, LIGHT, Colour, Palette, rgb
from .poses import Floats

UNLIMITED_N = 1e8
"""A push beyond it means that nothing known is the limit."""

WIDTH, HEIGHT, LEFT, RIGHT = 300.0, 34.0, 6.0, 6.0
HEADROOM = 1.25


@dataclass(frozen=True)
class GraspMeasures:
    """One message of `deformation/grasp`; lengths in m, forces in N.

    Attributes:
        frame: of points and normals. points, normals: (k, 3) on the outer face, inward.
        deformed: whether they are those of an equilibrium, not of the hand alone.
        closed, probability, needed, needed_sigma: force closure and the friction it needs [-].
        friction, friction_sigma: as given [-]. push: mean of the fingers. least, most: squeeze
            window. liftable, mass: what the squeeze lifts, what it is to lift [kg].
        slip, slip_finger: weight [N] at which the first finger slips while all stand still, and
            which; none below zero. dent: push at which the wall begins to yield. resolved:
            whether the stress behind it is. liftable_sigma: [kg].
    """

    frame: str
    points: Floats
    normals: Floats
    deformed: bool
    closed: bool
    probability: float
    needed: float
    needed_sigma: float
    friction: float
    friction_sigma: float
    push: float
    least: float
    most: float
    liftable: float
    mass: float
    slip: float = 0.0
    slip_finger: int = -1
    dent: float = 0.0
    resolved: bool = False
    liftable_sigma: float = 0.0


def colour_of(probability: float, palette: Palette = LIGHT) -> Colour:
    """From the colour of bad to that of good, by the probability of closure."""
    good, bad = rgb(palette.good), rgb(palette.bad)
    share = min(max(probability, 0.0), 1.0)
    red, green, blue = (round(b + share * (g - b)) for g, b in zip(good, bad, strict=True))
    return red, green, blue


def hold_html(grasp: GraspMeasures | None, told: str = '') -> str:
    """Closure in words and the window as a bar; empty while no grasp is known.

    `told`: what the solver says of closure, once a second: why there is none.
    """
    if grasp is None or not len(grasp.points):
        return ''
    word = 'closed' if grasp.closed else 'not closed'
    light, dark = (_css(colour_of(grasp.probability, one)) for one in (LIGHT, DARK))
    why = '' if grasp.closed else told.partition('not closed: ')[2]
    needs = 'no friction would do'
    if grasp.needed < 20.0:
        needs = f'needs {grasp.needed:.2f} ± {grasp.needed_sigma:.2f}'
    where = '' if grasp.deformed else ', normals of the hand'
    return (
        '<div class="grasp-section grasp-hold">'
        f'<b style="color:light-dark({light}, {dark})">{word}</b>'
        f'<i>{100.0 * grasp.probability:.0f} % sure</i>'
        f'{_paragraph(why)}'
        f'<p>friction {grasp.friction:.2f} ± {grasp.friction_sigma:.2f} given, {needs}{where}</p>'
        f'{window_svg(grasp)}<p>{_window_words(grasp)}</p>{_slip_words(grasp)}'
        '<p>friction is an input, tangential forces are of the model</p></div>'
    )


def _css(colour: Colour) -> str:
    return 'rgb({}, {}, {})'.format(*colour)


def _window_words(grasp: GraspMeasures) -> str:
    sure = f' ± {_mass(grasp.liftable_sigma)}' if grasp.liftable_sigma > 0.0 else ''
    lifts = f'squeeze {grasp.push:.1f} N lifts {_mass(grasp.liftable)}{sure}'
    if grasp.mass < 0.0:
        return f'{lifts}; a mass below zero has no window'
    most = f'at most {grasp.most:.1f} N' if grasp.most < UNLIMITED_N else 'no known limit above'
    if not grasp.mass > 0.0:
        return f'{lifts}; {most}'
    if not grasp.least < UNLIMITED_N:
        return f'{lifts}; no squeeze lifts {_mass(grasp.mass)}; {most}'
    return f'{lifts}; window for {_mass(grasp.mass)}: from {grasp.least:.1f} N, {most}'


def _slip_words(grasp: GraspMeasures) -> str:
    """First slip and yield, each where it is known."""
    told = []
    if grasp.slip_finger >= 0:
        told.append(f'F{grasp.slip_finger} slips first, under a weight of {grasp.slip:.1f} N')
    if 0.0 < grasp.dent < UNLIMITED_N:
        sure = '' if grasp.resolved else ' (stress not resolved)'
        told.append(f'a dent begins at {grasp.dent:.1f} N{sure}')
    return _paragraph('; '.join(told))


def _paragraph(text: str) -> str:
    return f'<p>{html.escape(text)}</p>' if text else ''


def _mass(kilograms: float) -> str:
    return f'{kilograms:.2f} kg' if kilograms >= 1.0 else f'{1e3 * kilograms:.0f} g'


def window_svg(grasp: GraspMeasures) -> str:
    """The squeeze window as a bar on a scale of force, the present squeeze as a mark."""
    known = [value for value in (grasp.push, grasp.least, grasp.most) if 0 < value < UNLIMITED_N]
    top = HEADROOM * max(known, default=1.0)

    def at(force: float) -> float:
        return LEFT + (WIDTH - LEFT - RIGHT) * min(max(force / top, 0.0), 1.0)

    begin, end = at(grasp.least), at(grasp.most)
    bar = ''
    if grasp.least <= grasp.most and grasp.least < UNLIMITED_N:
        kind = 'window' if grasp.closed else 'window open'
        bar = f'<rect class="{kind}" x="{begin:.1f}" y="8" width="{end - begin:.1f}" height="10"/>'
    x = at(grasp.push)
    return (
        f'<svg viewBox="0 0 {WIDTH:g} {HEIGHT:g}" role="img" aria-label="squeeze window">'
        f'<rect class="scale" x="{LEFT:g}" y="8" width="{WIDTH - LEFT - RIGHT:g}" height="10"/>'
        f'{bar}<path class="mark" d="M{x:.1f} 4V22"/>'
        f'<text x="{LEFT:g}" y="32">0</text>'
        f'<text x="{WIDTH - RIGHT:g}" y="32" text-anchor="end">{top:.1f} N</text></svg>'
    )
