# SPDX-License-Identifier: Apache-2.0
"""Deformed shells against 3-D scans: registration, distances, statistics, noise floor.

What a notebook needs, loaded with its first use:

    import scan_compare

    comparison = scan_compare.compare('scan.ply', 'tennis_ball')
    comparison.vertex.mean_m, comparison.noise_floor_m, comparison.beyond_noise

Everything else is imported from the modules of the package.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from scan_compare.comparison import Comparison, ComparisonError
    from scan_compare.front_door import compare
    from scan_compare.registration import RegistrationError
    from scan_compare.scan import Scan
    from scan_compare.scan_file import ScanFileError, read_scan

_PLACES = {
    'Comparison': 'comparison',
    'ComparisonError': 'comparison',
    'RegistrationError': 'registration',
    'Scan': 'scan',
    'ScanFileError': 'scan_file',
    'compare': 'front_door',
    'read_scan': 'scan_file',
}

__all__ = [
    'Comparison',
    'ComparisonError',
    'RegistrationError',
    'Scan',
    'ScanFileError',
    'compare',
    'read_scan',
]


def __getattr__(name: str) -> Any:
    """Load what is asked for from where it is defined."""
    if name not in _PLACES:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    return getattr(import_module(f'{__name__}.{_PLACES[name]}'), name)


def __dir__() -> list[str]:
    return __all__
