# SPDX-License-Identifier: Apache-2.0
"""Held by `make lint`: no function over 80 lines, 8 arguments or a complexity of 15.

Lines are those of the source, arguments and complexity what ruff counts (PLR0913, C901). What is
exempt stands below, each with its reason; an entry that is no longer needed is told.
"""

from __future__ import annotations

import ast
import json
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
MOST_LINES, MOST_ARGUMENTS, MOST_COMPLEXITY = 80, 8, 15
FOLDERS = ('ros2_ws/src', 'bags', 'docs', 'tests')

KERNEL = 'compiled kernel: arrays one by one, loops that numba fuses'
TWIN = 'twin of a compiled kernel, line by line'
SHELL = 'ros2_ws/src/shell_deform/shell_deform'
EXEMPT = {
    **dict.fromkeys(
        (
            f'{SHELL}/assemble/kernels.py::point_energies',
            f'{SHELL}/assemble/kernels.py::shell_gradient',
            f'{SHELL}/assemble/kernels.py::shell_tangent',
            f'{SHELL}/assemble/kernels.py::volume_gradient',
            f'{SHELL}/assemble/held_kernels.py::held_tangent',
            f'{SHELL}/assemble/thick_held_kernels.py::held_point',
            f'{SHELL}/assemble/thick_held_kernels.py::thick_held_tangent',
            f'{SHELL}/factor/blas.py::gemm',
            f'{SHELL}/factor/blas.py::gemv',
            f'{SHELL}/factor/blas.py::solve_lower_right',
            f'{SHELL}/factor/blas.py::subtract_gram',
            f'{SHELL}/factor/elimination.py::eliminate',
            f'{SHELL}/factor/fronts.py::factorise_fronts',
            f'{SHELL}/factor/nested_dissection.py::_minimum_cover',
            f'{SHELL}/factor/substitution.py::forward',
            f'{SHELL}/factor/symbolic.py::_maps',
            f'{SHELL}/grasp/cone_kernel.py::_direction',
            f'{SHELL}/grasp/cone_kernel.py::solve',
            f'{SHELL}/live/tick/fusion_kernel.py::_solve',
            f'{SHELL}/live/tick/serve_kernel.py::_serve',
            f'{SHELL}/theory/kernels.py::point_strains',
            f'{SHELL}/assemble/thick_face_kernels.py::face_bends',
            f'{SHELL}/assemble/thick_face_kernels.py::face_points',
            f'{SHELL}/assemble/thick_kernels.py::set_reach',
            f'{SHELL}/assemble/thick_kernels.py::thick_tangent',
            f'{SHELL}/assemble/thick_state_kernels.py::cell_equations',
            f'{SHELL}/assemble/thick_kernels.py::wall_point',
            f'{SHELL}/theory/thick_law_kernels.py::solve_thickness',
            f'{SHELL}/theory/thick_law_kernels.py::wall_stress',
            f'{SHELL}/theory/thick_strain_kernels.py::metric_numbers',
        ),
        KERNEL,
    ),
    **dict.fromkeys(
        (
            f'{SHELL}/live/tick/serve_kernel.py::serve_numpy',
            f'{SHELL}/surface/closest_point_plain.py::_take',
        ),
        TWIN,
    ),
}


def functions(path: Path) -> list[ast.FunctionDef | ast.AsyncFunctionDef]:
    """All functions of a file, those within others too."""
    tree = ast.walk(ast.parse(path.read_text()))
    return [one for one in tree if isinstance(one, ast.FunctionDef | ast.AsyncFunctionDef)]


def too_long(root: Path, folders: tuple[str, ...]) -> dict[str, str]:
    """Functions of more lines than allowed, by `file::name`."""
    found = {}
    for folder in folders:
        for path in (root / folder).rglob('*.py'):
            for one in functions(path):
                lines = (one.end_lineno or one.lineno) - one.lineno + 1
                if lines > MOST_LINES:
                    found[f'{path.relative_to(root)}::{one.name}'] = f'{lines} lines'
    return found


def too_wide(root: Path, folders: tuple[str, ...]) -> dict[str, str]:
    """Functions of more arguments or branches than allowed, outside tests, by `file::name`."""
    asked = subprocess.run(
        [
            sys.executable, '-m', 'ruff', 'check', '--isolated', '--output-format', 'json',
            '--select', 'C901,PLR0913', '--exclude', 'test',
            '--config', f'lint.mccabe.max-complexity={MOST_COMPLEXITY}',
            '--config', f'lint.pylint.max-args={MOST_ARGUMENTS}',
            *(str(root / folder) for folder in folders),
        ],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    found: dict[str, str] = {}
    for one in json.loads(asked.stdout):
        path = Path(one['filename'])
        row = one['location']['row']
        name = next(f.name for f in functions(path) if f.lineno == row)
        key = f'{path.relative_to(root)}::{name}'
        found[key] = f'{found[key]}; {one["message"]}' if key in found else one['message']
    return found


def violations(root: Path, folders: tuple[str, ...], exempt: dict[str, str]) -> list[str]:
    """One sentence for each function that is too large and not exempt."""
    large = too_long(root, folders)
    for key, text in too_wide(root, folders).items():
        large[key] = f'{large[key]}; {text}' if key in large else text
    for key in sorted(exempt.keys() - large.keys()):
        print(f'{key} is small enough by now: take it off the list in tests/sizes.py')
    return [f'{key}: {text}' for key, text in sorted(large.items()) if key not in exempt]


def main() -> int:
    """Print what is too large; 1 if anything is."""
    told = violations(ROOT, FOLDERS, EXEMPT)
    for sentence in told:
        print(sentence)
    return 1 if told else 0


if __name__ == '__main__':
    sys.exit(main())
