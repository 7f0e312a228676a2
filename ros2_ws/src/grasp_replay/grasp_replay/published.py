# SPDX-License-Identifier: Apache-2.0
"""The published table beside our predictions for its forces; no recording enters here."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from grasp_replay.experiment import read_published
from grasp_replay.theories import THEORIES, theory_set
from shell_deform.solve.equilibrium import Equilibrium
from shell_deform.theory import THICK

TABLE = Path('published') / 'table1.yaml'


def published_table(bag: Path) -> Path | None:
    """The published table beside the folder of a bag, None where there is none."""
    folder = bag if bag.is_dir() else bag.parent
    path = folder.resolve().parent / TABLE
    return path if path.is_file() else None


def published_predictions(
    path: Path, object_file: str, name: str, thick: bool = True
) -> list[dict[str, Any]]:
    """Rows of the table for object `name`, with the displacement every theory predicts [m].

    The object is taken as its file describes it, touched at its own contacts. A load that a
    theory does not carry is None. Empty when the table has no row of the object.
    """
    rows = read_published(path, name)
    if not rows:
        return []
    shell = theory_set(object_file, thick=thick)
    model = shell.model
    patches = tuple(
        model.contact(np.array(contact.at_m), contact.radius_m) for contact in shell.shell.contacts
    )
    states: dict[str, Equilibrium | None] = dict.fromkeys(THEORIES)
    found = []
    for row in sorted(rows, key=lambda row: row['force_n']):
        predicted: dict[str, float | None] = {}
        for theory in THEORIES:
            push = np.full(len(patches), float(row['force_n']))
            solved = shell.solve(theory, patches, push, states[theory])
            predicted[theory] = None
            if solved.surface is not None:
                states[theory] = solved.state
                predicted[theory] = solved.surface.max_displacement
        found.append(
            {
                **row,
                'predicted_max_displacement_m': predicted,
                'young_modulus_pa': shell.shell.young_modulus_pa,
                'solid_young_modulus_pa': shell.shell.modulus(THICK),
            }
        )
    return found
