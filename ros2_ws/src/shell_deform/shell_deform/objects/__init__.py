# SPDX-License-Identifier: Apache-2.0
"""Thin shells by name or file, and the control meshes that carry them."""

from .loader import load_object, object_names
from .object_mesh import middle_surface, object_fit_report, object_mesh
from .shell_object import Contact, Gas, GripPlace, ObjectError, ShellObject, Support, edge_names

__all__ = [
    'Contact',
    'Gas',
    'GripPlace',
    'ObjectError',
    'ShellObject',
    'Support',
    'edge_names',
    'load_object',
    'middle_surface',
    'object_fit_report',
    'object_mesh',
    'object_names',
]
