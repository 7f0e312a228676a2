# SPDX-License-Identifier: Apache-2.0
"""One scan against one shell, in one call: files, arrays and objects as a notebook has them."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from scan_compare.comparison import Comparison, Setup
from scan_compare.comparison import compare as compare_surfaces
from scan_compare.deformed_surface import DeformedSurface, surface_of_outer_face
from scan_compare.model_file import surface_of_object
from scan_compare.registration import SCANNER_SIGMA
from scan_compare.rigid import IDENTITY, Pose
from scan_compare.scan import Scan, clean
from scan_compare.scan_file import read_scan
from shell_deform.theory import THICK


class SqueezedShell(Protocol):
    """What `shell_deform` gives for a squeezed shell."""

    @property
    def shell(self) -> Any:
        """The shell: its `model` and `description`."""

    @property
    def outer_points(self) -> npt.NDArray[np.float64]:
        """(n, 3) deformed points of the outer face, one per control vertex [m]."""

    @property
    def control_points(self) -> npt.NDArray[np.float64]:
        """(n, 3) deformed control points [m]."""


def compare(
    scan: str | Path | npt.ArrayLike | Scan,
    shell: str | Path | SqueezedShell | DeformedSurface,
    *,
    unit: str | None = None,
    undeformed: str | Path | npt.ArrayLike | Scan | None = None,
    scanner_sigma: float = SCANNER_SIGMA,
    start: Pose | None = IDENTITY,
) -> Comparison:
    """Compare a scan with the outer face of a shell.

    `scan`, `undeformed` (the same object before it was squeezed): files, or points (s, 3) [m].
    `shell`: the name of an object or an object file, at rest, or a shell squeezed by
    `shell_deform`. `unit` of the files, inferred from the object's size if None.
    `scanner_sigma`: noise of a point along the normal [m]. `start`: pose of the scan in the
    object's frame to start from, None to search all rotations. Raises ScanFileError, ObjectError,
    RegistrationError or ComparisonError, each with one sentence.
    """
    surface = _surface(shell)
    return compare_surfaces(
        _scan(scan, unit, surface),
        surface,
        None if undeformed is None else _scan(undeformed, unit, surface.at_rest()),
        Setup(scanner_sigma_m=scanner_sigma, start=start),
    )


def _scan(scan: Any, unit: str | None, surface: DeformedSurface) -> Scan:
    if isinstance(scan, Scan):
        return scan
    if isinstance(scan, str | Path):
        return read_scan(scan, unit, surface.extent)
    cleaned = clean(np.array(scan, dtype=float).reshape(-1, 3), None)
    return Scan(cleaned.points, None, 'm', False, 'the points given', cleaned.notes)


def _surface(shell: Any) -> DeformedSurface:
    if isinstance(shell, DeformedSurface):
        return shell
    if isinstance(shell, str | Path):
        return surface_of_object(str(shell))
    model = shell.shell.model
    thickness = shell.shell.description.thickness_m
    if model.theory == THICK:
        rest = model.shell.outer_face(model.start)
        return surface_of_outer_face(model.surface, rest, shell.outer_points, thickness)
    return DeformedSurface(model.surface, model.rest, shell.control_points, thickness)
