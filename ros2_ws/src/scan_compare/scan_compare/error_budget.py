# SPDX-License-Identifier: Apache-2.0
"""Error budget: how much of a reported error each cause accounts for, on a recording with truth.

The paper lists scanner accuracy, occlusion, merging of views, the drift of the force and the air
in the ball as causes, without numbers. Here each is switched off alone and the comparison is
repeated; what the error loses is that cause's share.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from scan_compare.comparison import Comparison, Setup, compare
from scan_compare.deformed_surface import DeformedSurface
from scan_compare.scan import Scan

CAUSES = ('noise', 'occlusion', 'merging', 'force', 'air')
"""Scanner noise, occlusion and the merging of views spoil the scan; the error of the measured
force and the neglect of the sealed air spoil the model."""

MakeScan = Callable[[frozenset[str]], Scan]
MakeSurface = Callable[[frozenset[str]], DeformedSurface]


class BudgetError(ValueError):
    """An error budget that cannot be drawn up; the message says what is missing."""


@dataclass(frozen=True)
class BudgetRow:
    """One line of a budget: errors [m] with the named cause switched off.

    share_m: by how much the mean error falls without this cause (negative if it rises).
    """

    cause: str
    mean_error_m: float
    dent_mean_error_m: float | None
    max_error_m: float | None
    share_m: float


@dataclass(frozen=True)
class Budget:
    """rows: 'all causes', then each cause off alone, then 'no cause' (the model itself)."""

    rows: tuple[BudgetRow, ...]

    def to_json(self) -> list[dict[str, object]]:
        """Return the rows as plain dictionaries."""
        return [vars(row).copy() for row in self.rows]

    def text(self) -> str:
        """Return the budget as a table in millimetres."""
        lines = [f'{"causes":22s} {"mean":>7s} {"dent":>7s} {"max":>7s} {"share":>7s}   [mm]']
        for row in self.rows:
            numbers = (row.mean_error_m, row.dent_mean_error_m, row.max_error_m, row.share_m)
            cells = ['-' if v is None else f'{1e3 * v:.3f}' for v in numbers]
            lines.append(f'{row.cause:22s} ' + ' '.join(f'{cell:>7s}' for cell in cells))
        return '\n'.join(lines)


def error_budget(
    make_scan: MakeScan,
    make_surface: MakeSurface,
    causes: tuple[str, ...] = CAUSES,
    scanner_sigma_m: float = 0.127e-3,
) -> Budget:
    """Compare with every cause on, each off alone, and all off.

    make_scan(on), make_surface(on): the scan and the model with the causes in `on` at work. For
    'force' the model is solved with the measured force when on and the true one when off; for
    'air' the model leaves the sealed air out when on. Raises BudgetError for no causes.
    """
    if not causes:
        raise BudgetError('an error budget needs at least one cause')
    everything = frozenset(causes)

    def errors(on: frozenset[str]) -> Comparison:
        return compare(
            make_scan(on), make_surface(on), setup=Setup(scanner_sigma_m=scanner_sigma_m)
        )

    whole = errors(everything)

    def row(name: str, found: Comparison) -> BudgetRow:
        return BudgetRow(
            name,
            found.vertex.mean_m,
            None if found.dent is None else found.dent.mean_m,
            found.max_error_m,
            whole.vertex.mean_m - found.vertex.mean_m,
        )

    rows = [row('all causes', whole)]
    rows += [row(f'without {cause}', errors(everything - {cause})) for cause in causes]
    rows.append(row('no cause', errors(frozenset())))
    return Budget(tuple(rows))


def model_surfaces(
    with_errors: DeformedSurface,
    true_force: DeformedSurface,
    with_air: DeformedSurface,
    true_force_with_air: DeformedSurface,
) -> MakeSurface:
    """Return a maker of models: measured or true force, without or with the sealed air."""
    table = {
        (True, True): with_errors,
        (False, True): true_force,
        (True, False): with_air,
        (False, False): true_force_with_air,
    }
    return lambda on: table['force' in on, 'air' in on]
