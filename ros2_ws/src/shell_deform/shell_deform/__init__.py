# SPDX-License-Identifier: Apache-2.0
"""Live deformed surface of a thin shell in a robot hand, on Loop subdivision surfaces.

What a notebook needs, and nothing else; importing it is fast, the solver is loaded with first use:

    >>> import shell_deform
    >>> ball = shell_deform.load('tennis_ball')
    >>> squeezed = ball.squeeze(displacement=2e-3)
    >>> round(float(squeezed.contact_force[0]), 1)
    9.1

SI units; points are of the middle surface. Everything else is imported from the rooms of the
package (`docs/architecture.md`).
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from shell_deform.objects import ObjectError, object_names
    from shell_deform.squeeze import Shell, Squeezed, SqueezeError, Stresses, Sweep, load

_PLACES = {
    'ObjectError': 'objects',
    'Shell': 'squeeze',
    'SqueezeError': 'squeeze',
    'Squeezed': 'squeeze',
    'Stresses': 'squeeze',
    'Sweep': 'squeeze',
    'load': 'squeeze',
    'object_names': 'objects',
}

__all__ = [
    'ObjectError',
    'Shell',
    'SqueezeError',
    'Squeezed',
    'Stresses',
    'Sweep',
    'load',
    'object_names',
]


def __getattr__(name: str) -> Any:
    """Load what is asked for from where it is defined."""
    if name not in _PLACES:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    return getattr(import_module(f'{__name__}.{_PLACES[name]}'), name)


def __dir__() -> list[str]:
    return __all__
