# SPDX-License-Identifier: Apache-2.0
"""Numbers to colours that read without colour vision, and the legend that says what they mean.

Sizes: porcelain at zero, then cividis (Nunez, Anderton, Renslow 2018,
doi:10.1371/journal.pone.0199239) from its yellow down to its navy, so that more is darker and the
untouched body is light enough to show its shading. Signed numbers: porcelain at zero, navy below
and brown above, lightness falling both ways. Light only darkens a colour a little (`shading`).

The browser's renderer applies a film tone curve to every colour; `renderer_colours` hands it the
colours from which the curve makes the wanted ones. A pixel in full light is the legend's.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.floating]
Bytes = npt.NDArray[np.uint8]

_CIVIDIS = (
    '00224e00234f00245100255300255400265600275800285900285b00295d002a5f002a61002b62002c64'
    '002c66002d68002e6a002e6c002f6d00306f0030700031700031710132710533710833700c34700f3570'
    '12357014367016377018376f1a386f1c396f1e3a6f203a6f213b6e233c6e243c6e263d6e273e6e293f6e'
    '2a3f6d2b406d2d416d2e416d2f426d31436d32436d33446d34456c35456c36466c38476c39486c3a486c'
    '3b496c3c4a6c3d4a6c3e4b6c3f4c6c404c6c414d6c424e6c434e6c444f6c45506c46516c47516c48526c'
    '49536c4a536c4b546c4c556c4d556c4e566c4f576c50576c51586d52596d535a6d545a6d555b6d555c6d'
    '565c6d575d6d585e6d595e6e5a5f6e5b606e5c616e5d616e5e626e5e636f5f636f60646f61656f62656f'
    '636670646770656870656870666970676a71686a71696b716a6c716b6d726c6d726c6e726d6f726e6f73'
    '6f70737071737172747272747273747374757474757575757676767777767777777878777979777a7a78'
    '7b7a787c7b787d7c787e7c787e7d787f7e78807f78817f78828079838179848279858279868379878478'
    '8885788985788a86788b87788c88788d88788e89788f8a78908b78918b78928c78928d78938e78948e77'
    '958f779690779791779892779992779a93769b94769c95769d95769e96769f9775a09875a19975a29975'
    'a39a74a49b74a59c74a69c74a79d73a89e73a99f73aaa073aba072aca172ada272aea371afa471b0a571'
    'b1a570b3a670b4a76fb5a86fb6a96fb7a96eb8aa6eb9ab6dbaac6dbbad6dbcae6cbdae6cbeaf6bbfb06b'
    'c0b16ac1b26ac2b369c3b369c4b468c5b568c6b667c7b767c8b866c9b965cbb965ccba64cdbb63cebc63'
    'cfbd62d0be62d1bf61d2c060d3c05fd4c15fd5c25ed6c35dd7c45cd9c55cdac65bdbc75adcc859ddc858'
    'dec958dfca57e0cb56e1cc55e2cd54e4ce53e5cf52e6d051e7d150e8d24fe9d34eead34cebd44bedd54a'
    'eed649efd748f0d846f1d945f2da44f3db42f5dc41f6dd3ff7de3ef8df3cf9e03afbe138fce236fde334'
    'fee434fee535fee636fee838'
)
CIVIDIS: Bytes = np.frombuffer(bytes.fromhex(_CIVIDIS), dtype=np.uint8).reshape(256, 3)
NO_VALUE: Bytes = np.array([170, 170, 170], dtype=np.uint8)

# The ACES filmic curve as three.js fits it (after S. Hill): colour -> 1/0.6 -> into -> curve ->
# out; the curve is (x (x + a) - b) / (x (c x + d) + e).
_INTO = np.array(
    [[0.59719, 0.35458, 0.04823], [0.07600, 0.90834, 0.01566], [0.02840, 0.13383, 0.83777]]
)
_OUT = np.array(
    [[1.60475, -0.53108, -0.07367], [-0.10208, 1.10813, -0.00605], [-0.00327, -0.07276, 1.07602]]
)
_CURVE = (0.0245786, 0.000090537, 0.983729, 0.4329510, 0.238081)
_EXPOSURE = 0.6


def linear_light(colours: Bytes) -> Floats:
    """sRGB bytes (..., 3) to linear light in 0..1 (IEC 61966-2-1)."""
    value = np.asarray(colours, dtype=np.float64) / 255.0
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def tone_curve(colours: Floats) -> Floats:
    """What the renderer makes of linear colours (n, 3), before its conversion to sRGB."""
    a, b, c, d, e = _CURVE
    x = (colours / _EXPOSURE) @ _INTO.T
    return np.clip(((x * (x + a) - b) / (x * (c * x + d) + e)) @ _OUT.T, 0.0, 1.0)


def renderer_colours(colours: Bytes) -> npt.NDArray[np.float32]:
    """Linear float32 colours (n, 3) that the renderer's tone curve turns into `colours` (sRGB)."""
    a, b, c, d, e = _CURVE
    y = linear_light(colours) @ np.linalg.inv(_OUT).T
    first, second, third = 1.0 - c * y, a - d * y, -b - e * y
    x = (-second + np.sqrt(second * second - 4.0 * first * third)) / (2.0 * first)
    return np.asarray((x @ np.linalg.inv(_INTO).T) * _EXPOSURE, dtype=np.float32)


PORCELAIN = (236, 234, 227)
# The share of the scale over which porcelain turns to yellow, and where in cividis that yellow is:
# more of the first, or a yellow further up, and two values differ less than light and shade do.
PALE_SHARE, YELLOW = 0.05, 0.92
BELOW = (PORCELAIN, (150, 178, 205), (52, 96, 150), (0, 34, 78))
ABOVE = (PORCELAIN, (225, 172, 116), (170, 86, 24), (86, 34, 4))


def between(stops: Sequence[float], colours: npt.ArrayLike, at: Floats) -> Bytes:
    """Colours (n, 3) at places (n,) between `stops`, whose colours are given (s, 3); sRGB."""
    rows = np.asarray(colours, dtype=np.float64)
    mixed = np.stack([np.interp(at, stops, rows[:, k]) for k in range(3)], axis=1)
    return np.round(mixed).astype(np.uint8)


def _sizes() -> Bytes:
    share = np.arange(256) / 255.0
    stops = np.concatenate([[0.0], np.linspace(PALE_SHARE, 1.0, 220)])
    place = np.linspace(YELLOW, 0.0, 220) * 255.0
    cividis = np.stack([np.interp(place, np.arange(256), CIVIDIS[:, k]) for k in range(3)], 1)
    return between(stops.tolist(), np.vstack([PORCELAIN, cividis]), share)


def _signed() -> Bytes:
    stops = (-1.0, -0.6, -0.2, 0.0, 0.2, 0.6, 1.0)
    return between(stops, [*BELOW[:0:-1], PORCELAIN, *ABOVE[1:]], np.linspace(-1.0, 1.0, 256))


# Rows 0 to 255 from the lower to the upper end of the scale; row 256 is `no value`.
TABLE: Bytes = np.vstack([_sizes(), NO_VALUE])
SIGNED_TABLE: Bytes = np.vstack([_signed(), NO_VALUE])


def colour_index(values: Floats, low: float, high: float) -> npt.NDArray[np.intp]:
    """Rows (n,) of `TABLE` for `values` on the scale low..high; NaN gives the `no value` row."""
    span = high - low
    step = (
        (np.asarray(values, dtype=np.float64) - low) / span if span > 0 else np.zeros(len(values))
    )
    known = np.isfinite(step)
    index = np.round(np.clip(np.where(known, step, 0.0), 0.0, 1.0) * 255.0).astype(np.intp)
    return np.where(known, index, 256)


def nice_ceiling(value: float) -> float:
    """The smallest 1, 2, 2.5 or 5 times a power of ten that is >= value; 1e-9 for 0 or less."""
    if not value > 1e-9:
        return 1e-9
    power = float(10.0 ** np.floor(np.log10(value)))
    return next(s * power for s in (1.0, 2.0, 2.5, 5.0, 10.0) if value <= s * power * (1 + 1e-9))


class SteadyScale:
    """An upper end of the scale that grows at once and shrinks only when far too large.

    Without it every small change of the largest value would recolour the whole surface.
    """

    def __init__(self, smallest: float) -> None:
        self.smallest = smallest
        self.top = smallest

    def follow(self, largest: float) -> float:
        """Take the largest value shown now; returns the scale's upper end (same unit)."""
        wanted = max(self.smallest, nice_ceiling(largest))
        if wanted > self.top or wanted <= 0.4 * self.top:
            self.top = wanted
        return self.top


def three_digits(value: float) -> str:
    """A number with three significant digits and no exponent; below 1e-6 it is 0."""
    return f'{float(f"{value:.3g}"):.10g}' if abs(value) >= 1e-6 else '0'


def legend_html(title: str, unit: str, low: float, high: float, note: str = '') -> str:
    """The legend as HTML: what is shown, its unit, the colour bar and five numbers, a note."""
    table = SIGNED_TABLE if low < 0.0 else TABLE
    stops = ', '.join('#' + bytes(table[round(k * 255 / 32)]).hex() for k in range(33))
    numbers = ''.join(f'<span>{three_digits(low + (high - low) * k / 4)}</span>' for k in range(5))
    return (
        f'<div class="grasp-legend"><b>{title} ({unit})</b>'
        f'<div class="bar" style="background:linear-gradient(to right, {stops})"></div>'
        f'<div class="grasp-legend-numbers">{numbers}</div><p>{note}</p></div>'
    )
