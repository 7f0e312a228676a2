# SPDX-License-Identifier: Apache-2.0
"""Calibration of the strain gauges: counts to torque per finger, from a file, never hard-coded.

Every gauge differs and its zero drifts, so a conversion is used relative to a tared zero x0:
`difference` takes f(x) - f(x0); `shift` takes f(x - x0 + x_ref) - f(x_ref), which moves a curved
law along with the zero.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from barrett_hand_bridge.hand import FINGERS
from grasp_common import bounded_yaml

FORMAT = 'barrett_hand_calibration/1'
DOCUMENTED_RANGE_NM = 1.0
FINGER_KEYS = {
    'kind',
    'coefficients_nm',
    'counts',
    'torque_nm',
    'zero',
    'reference_counts',
    'no_load_counts',
    'noise_counts',
    'residual_nm',
    'relative_sigma',
    'valid_torque_nm',
}


class CalibrationError(ValueError):
    """A calibration that cannot be used; the message names file, key and value."""


@dataclass(frozen=True)
class GaugeCalibration:
    """The law of one gauge.

    `cubic`: torque in N m = sum of coefficients times powers of the count, lowest first. `table`:
    torque at counts, straight lines between. `none`: no gauge on this finger. Sigmas: white noise
    in counts, scatter of the fit in N m, and the relative uncertainty of its slope.
    """

    kind: str
    coefficients_nm: tuple[float, ...] = ()
    counts: tuple[float, ...] = ()
    torque_nm: tuple[float, ...] = ()
    zero: str = 'difference'
    reference_counts: float = 0.0
    no_load_counts: tuple[float, float] = (0.0, 0.0)
    noise_counts: float = 0.0
    residual_nm: float = 0.0
    relative_sigma: float = 0.0
    valid_torque_nm: float = DOCUMENTED_RANGE_NM

    def law(self, counts: float) -> float:
        """The fitted law in N m at a count, before any zero is taken off."""
        if self.kind == 'table':
            return _interpolate(self.counts, self.torque_nm, counts)
        value = 0.0
        for coefficient in reversed(self.coefficients_nm):
            value = value * counts + coefficient
        return value

    def torque(self, counts: float, zero_counts: float) -> float:
        """Torque in N m at a reading, relative to the tared zero."""
        if self.zero == 'shift':
            shifted = counts - zero_counts + self.reference_counts
            return self.law(shifted) - self.law(self.reference_counts)
        return self.law(counts) - self.law(zero_counts)

    def slope(self, counts: float, zero_counts: float) -> float:
        """N m per count at a reading."""
        return 0.5 * (
            self.torque(counts + 1.0, zero_counts) - self.torque(counts - 1.0, zero_counts)
        )


NO_GAUGE = GaugeCalibration('none')


@dataclass(frozen=True)
class HandCalibration:
    """Calibrations of all fingers of one hand, by its serial number."""

    hand: str
    serial_number: str
    fingers: Mapping[int, GaugeCalibration] = field(default_factory=dict)
    source: str = ''


def _interpolate(x: tuple[float, ...], y: tuple[float, ...], at: float) -> float:
    """Straight lines through the points, the first and the last going on beyond the ends."""
    index = min(max(int(np.searchsorted(x, at)) - 1, 0), len(x) - 2)
    slope = (y[index + 1] - y[index]) / (x[index + 1] - x[index])
    return y[index] + slope * (at - x[index])


def read_calibration(path: Path) -> HandCalibration:
    """Read a calibration file (YAML).

    Raises:
        CalibrationError: missing or unreadable file, unknown key, wrong or impossible value.
    """
    try:
        document = bounded_yaml.read(path)
    except (OSError, UnicodeDecodeError) as error:
        raise CalibrationError(
            f'calibration {path}: cannot be read ({error}); make one with hand_calibrate'
        ) from error
    except yaml.YAMLError as error:
        raise CalibrationError(f'calibration {path}: not YAML ({error})') from error
    if not isinstance(document, dict) or document.get('format') != FORMAT:
        raise CalibrationError(f'calibration {path}: key format must be {FORMAT!r}')
    unknown = set(document) - {'format', 'hand', 'serial_number', 'fingers', 'source'}
    if unknown:
        raise CalibrationError(f'calibration {path}: unknown key {sorted(map(str, unknown))[0]!r}')
    fingers = document.get('fingers')
    if not isinstance(fingers, dict) or set(fingers) != set(FINGERS):
        raise CalibrationError(f'calibration {path}: fingers must be given as 1, 2 and 3')
    return HandCalibration(
        hand=str(document.get('hand', '')),
        serial_number=str(document.get('serial_number', '')),
        fingers={finger: _gauge(fingers[finger], finger, path) for finger in FINGERS},
        source=str(path),
    )


def _gauge(document: Any, finger: int, path: Path) -> GaugeCalibration:
    where = f'calibration {path}, finger {finger}'
    if not isinstance(document, dict):
        raise CalibrationError(f'{where}: not a mapping')
    unknown = set(document) - FINGER_KEYS
    if unknown:
        raise CalibrationError(f'{where}: unknown key {sorted(map(str, unknown))[0]!r}')
    kind = document.get('kind')
    if kind == 'none':
        return NO_GAUGE
    if kind not in ('cubic', 'table'):
        raise CalibrationError(f'{where}: kind is {kind!r}, must be cubic, table or none')
    if document.get('zero') not in ('difference', 'shift'):
        raise CalibrationError(
            f'{where}: zero is {document.get("zero")!r}, must be difference or shift'
        )
    band = _numbers(document, 'no_load_counts', where)
    if len(band) != 2 or band[0] >= band[1]:
        raise CalibrationError(f'{where}: no_load_counts must be two rising counts, is {band}')
    gauge = GaugeCalibration(
        kind=kind,
        coefficients_nm=_numbers(document, 'coefficients_nm', where) if kind == 'cubic' else (),
        counts=_numbers(document, 'counts', where) if kind == 'table' else (),
        torque_nm=_numbers(document, 'torque_nm', where) if kind == 'table' else (),
        zero=str(document['zero']),
        reference_counts=_number(document, 'reference_counts', where),
        no_load_counts=(band[0], band[1]),
        noise_counts=_positive(document, 'noise_counts', where),
        residual_nm=_positive(document, 'residual_nm', where),
        relative_sigma=_positive(document, 'relative_sigma', where),
        valid_torque_nm=_positive(document, 'valid_torque_nm', where),
    )
    _check_rising(gauge, where)
    return gauge


def _check_rising(gauge: GaugeCalibration, where: str) -> None:
    if gauge.kind == 'table':
        x, y = np.asarray(gauge.counts), np.asarray(gauge.torque_nm)
        if x.size < 2 or x.shape != y.shape or (np.diff(x) <= 0).any() or (np.diff(y) <= 0).any():
            raise CalibrationError(
                f'{where}: counts and torque_nm must rise strictly, equally long'
            )
    elif not 2 <= len(gauge.coefficients_nm) <= 4:
        raise CalibrationError(
            f'{where}: coefficients_nm needs 2 to 4 numbers, lowest power first'
        )
    zero = gauge.reference_counts
    if gauge.slope(zero, zero) <= 0.0:
        raise CalibrationError(f'{where}: torque falls with rising counts at count {zero:g}')


def _number(document: Mapping[str, Any], key: str, where: str) -> float:
    value = document.get(key)
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise CalibrationError(f'{where}: {key} is {value!r}, must be a finite number')
    return float(value)


def _positive(document: Mapping[str, Any], key: str, where: str) -> float:
    value = _number(document, key, where)
    if value < 0.0:
        raise CalibrationError(f'{where}: {key} is {value}, must not be negative')
    return value


def _numbers(document: Mapping[str, Any], key: str, where: str) -> tuple[float, ...]:
    values = document.get(key)
    if not isinstance(values, list):
        raise CalibrationError(f'{where}: {key} is {values!r}, must be a list of numbers')
    return tuple(_number({key: value}, key, where) for value in values)


def write_calibration(calibration: HandCalibration, path: Path) -> None:
    """Write a calibration file that `read_calibration` reads back unchanged.

    Raises:
        CalibrationError: the file cannot be written.
    """
    fingers: dict[int, dict[str, Any]] = {}
    for finger, gauge in sorted(calibration.fingers.items()):
        if gauge.kind == 'none':
            fingers[finger] = {'kind': 'none'}
            continue
        entry: dict[str, Any] = {'kind': gauge.kind}
        if gauge.kind == 'cubic':
            entry['coefficients_nm'] = list(gauge.coefficients_nm)
        else:
            entry['counts'] = list(gauge.counts)
            entry['torque_nm'] = list(gauge.torque_nm)
        entry.update(
            zero=gauge.zero,
            reference_counts=gauge.reference_counts,
            no_load_counts=list(gauge.no_load_counts),
            noise_counts=gauge.noise_counts,
            residual_nm=gauge.residual_nm,
            relative_sigma=gauge.relative_sigma,
            valid_torque_nm=gauge.valid_torque_nm,
        )
        fingers[finger] = entry
    document = {
        'format': FORMAT,
        'hand': calibration.hand,
        'serial_number': calibration.serial_number,
        'fingers': fingers,
    }
    try:
        path.write_text(yaml.safe_dump(document, sort_keys=False), encoding='utf-8')
    except OSError as error:
        raise CalibrationError(f'calibration {path}: cannot be written ({error})') from error
