# SPDX-License-Identifier: Apache-2.0
"""A shell as a 3-D solid in CalculiX: deck, load history, sealed gas, kept result.

Lengths in mm, forces in N, pressures in MPa inside; results are kept in SI units.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from bags import calculix, hexahedra
from bags.calculix import Array
from bags.hexahedra import Solid

FOLDER = Path(__file__).parent / 'solid'
AMBIENT_MPA = 0.101325


@dataclass(frozen=True)
class Contact:
    """A pin: centre on the rest outer face (mm), unit direction of its force, radius, kind.

    `traction` spreads the force evenly and dead; `rigid` moves the outer nodes within the radius
    together along the direction and lets them slide sideways. `share` is the part of the force
    that the modelled sector carries.
    """

    centre: tuple[float, float, float]
    direction: tuple[float, float, float]
    radius: float = 1.0
    kind: str = 'traction'
    share: float = 1.0


@dataclass(frozen=True)
class Model:
    """One sector of a shell and everything that holds it."""

    heading: str
    solid: Solid
    material: str
    contacts: tuple[Contact, ...]
    fixed: tuple[tuple[int, int], ...] = ()
    equations: tuple[tuple[tuple[int, int, float], ...], ...] = ()
    sectors: int = 1
    gas_centre: tuple[float, float, float] | None = None
    meta: dict = field(default_factory=dict)


@dataclass(frozen=True)
class History:
    """Displacements (levels, nodes, 3) in mm under forces (N) and gas pressures (MPa)."""

    model: Model
    forces: Array
    pressures: Array
    volumes: Array
    rest_volume: float
    displacements: Array
    deck: str

    def contact_displacements(self, depth: float) -> Array:
        """Displacement along each contact's direction, (levels, contacts), in mm.

        `depth` 0 reads the outer face, 0.5 mid-thickness, 1 the inner face.
        """
        solid = self.model.solid
        columns = []
        for contact in self.model.contacts:
            outer = solid.near(np.array(contact.centre))
            below = solid.positions[outer] - depth * solid.thickness * solid.rest_normals[outer]
            columns.append(self.displacements[:, solid.near(below)] @ np.array(contact.direction))
        return np.stack(columns, axis=1)


def symmetric(solid: Solid, normal: Sequence[float] | Array, tolerance: float = 1e-5) -> list[int]:
    """Node numbers on the plane through the origin with this unit normal."""
    return (np.flatnonzero(abs(solid.positions @ np.asarray(normal)) < tolerance) + 1).tolist()


def _pin_cards(model: Model) -> tuple[list[str], list[dict[tuple[int, int], float]]]:
    """Equations of the rigid pins, and per contact the nodal loads for a force of 1 N."""
    cards: list[str] = []
    loads: list[dict[tuple[int, int], float]] = []
    for contact in model.contacts:
        direction = np.array(contact.direction)
        centre = np.array(contact.centre)
        if contact.kind == 'traction':
            shares = hexahedra.disc_shares(model.solid, centre, contact.radius)
        else:
            outer = np.unique(model.solid.outer)
            far = np.linalg.norm(model.solid.positions[outer - 1] - centre, axis=1)
            first, *others = outer[np.argsort(far, kind='stable')][
                : int((far <= contact.radius * 1.0001).sum())
            ].tolist()
            cards += [_along_together(node, first, direction) for node in others]
            shares = {first: 1.0}
        loads.append(
            {
                (node, axis + 1): contact.share * share * float(direction[axis])
                for node, share in shares.items()
                for axis in range(3)
                if abs(direction[axis]) > 1e-12
            }
        )
    return cards, loads


def _along_together(node: int, first: int, direction: Array) -> str:
    """Equation direction . u(node) = direction . u(first), solved for its largest component."""
    by_size = np.argsort(-abs(direction), kind='stable').tolist()
    order = [axis for axis in by_size if abs(direction[axis]) > 1e-9]
    terms = [(node, axis + 1, direction[axis]) for axis in order]
    terms += [(first, axis + 1, -direction[axis]) for axis in order]
    return equation(tuple(terms))


def equation(terms: tuple[tuple[int, int, float], ...]) -> str:
    """Data lines of one *EQUATION, at most four terms a line."""
    texts = [f'{node},{axis},{factor:.12g}' for node, axis, factor in terms]
    rows = [','.join(texts[start : start + 4]) for start in range(0, len(texts), 4)]
    return '\n'.join([str(len(terms)), *rows])


def deck(model: Model, forces: Array, pressures: Array, nonlinear: bool = True) -> str:
    """The CalculiX input: one static step per (contact force, gas pressure)."""
    solid = model.solid
    pin_cards, loads = _pin_cards(model)
    equations = [equation(terms) for terms in model.equations] + pin_cards
    parts = [
        '*HEADING',
        model.heading,
        '*NODE,NSET=ALL',
        calculix.node_lines(dict(enumerate(solid.positions.tolist(), 1))),
        '*ELEMENT,TYPE=C3D20R,ELSET=WALL',
        calculix.element_lines(solid.elements),
        calculix.set_lines('INSIDE', 'EL', solid.inner_elements),
        '*MATERIAL,NAME=WALL',
        model.material,
        '*SOLID SECTION,ELSET=WALL,MATERIAL=WALL',
        *(['*EQUATION', *equations] if equations else []),
        '*BOUNDARY',
        *(f'{node},{axis},{axis}' for node, axis in sorted(set(model.fixed))),
    ]
    for force, pressure in zip(forces, pressures, strict=True):
        parts += ['*STEP,NLGEOM,INC=300' if nonlinear else '*STEP', '*STATIC', '0.5,1.0,1e-4']
        parts.append('*CLOAD')
        for load in loads:
            parts += [f'{node},{axis},{force * part:.12g}' for (node, axis), part in load.items()]
        if model.gas_centre is not None:
            parts += ['*DLOAD', f'INSIDE,P1,{pressure:.12g}']
        parts += ['*NODE PRINT,NSET=ALL', 'U', '*END STEP']
    return '\n'.join(parts) + '\n'


def solve(
    model: Model,
    forces: Array,
    pressures: Array | None = None,
    nonlinear: bool = True,
    timeout: float = 900.0,
) -> History:
    """Solve a force history with given gas pressures (none when the shell is open)."""
    forces = np.asarray(forces, dtype=float)
    pressures = np.zeros(len(forces)) if pressures is None else pressures
    text = deck(model, forces, pressures, nonlinear)
    tables = calculix.run(text, 'shell', timeout)
    count = len(model.solid.positions)
    moved = []
    times = sorted(tables)
    if abs(times[-1] - len(forces)) > 1e-6:
        raise calculix.CalculixError(f'the history ended at {times[-1]} of {len(forces)} steps')
    for step in range(1, len(forces) + 1):
        rows = tables[min(times, key=lambda time: abs(time - step))]['displacements', 'ALL']
        moved.append([rows[number] for number in range(1, count + 1)])
    displacements = np.array(moved)
    if model.gas_centre is None:
        volumes, rest = np.ones(len(forces)), 1.0
    else:
        centre = np.array(model.gas_centre)
        rest = _volume(model, model.solid.positions, centre)
        volumes = np.array(
            [_volume(model, model.solid.positions + shift, centre) for shift in displacements]
        )
    return History(model, forces, pressures, volumes, rest, displacements, text)


def _volume(model: Model, positions: Array, centre: Array) -> float:
    return model.sectors * hexahedra.enclosed_volume(model.solid, positions, centre)


def solve_sealed(
    model: Model,
    forces: Array,
    first_guess: Array,
    tolerance: float = 1e-4,
    timeout: float = 900.0,
) -> History:
    """The same with ambient air sealed in, isothermal: pressures of all levels iterated together.

    Stops when (p + ambient) V agrees with ambient V0 within `tolerance` of it at every level.
    """
    history = solve(model, forces, first_guess, timeout=timeout)
    previous: tuple[Array, Array] | None = None
    for _ in range(6):
        wanted = AMBIENT_MPA * (history.rest_volume / history.volumes - 1.0)
        residual = wanted - history.pressures
        if np.all(abs(residual) <= tolerance * AMBIENT_MPA):
            return history
        slope = np.full(len(residual), -1.3)
        if previous is not None:
            change = history.pressures - previous[0]
            found = (residual - previous[1]) / np.where(change == 0.0, 1.0, change)
            slope = np.where(found < -0.2, found, slope)
        previous = (history.pressures, residual)
        history = solve(model, forces, history.pressures - residual / slope, timeout=timeout)
    raise calculix.CalculixError('sealed gas: pressure and volume did not come to agree')


def keep(history: History, name: str) -> None:
    """Write result (`.npz` outer face, `.json` numbers) and deck (`.inp.gz`) side by side."""
    FOLDER.mkdir(exist_ok=True)
    model = history.model
    solid = model.solid
    outer, faces = np.unique(solid.outer, return_inverse=True)
    np.savez_compressed(
        FOLDER / f'{name}.npz',
        rest_m=(solid.positions[outer - 1] * 1e-3).astype(np.float32),
        faces=faces.reshape(-1, 8).astype(np.int32),
        force_n=history.forces,
        displacement_m=(history.displacements[:, outer - 1] * 1e-3).astype(np.float32),
    )
    middle = history.contact_displacements(0.5) * 1e-3
    top = history.contact_displacements(0.0) * 1e-3
    found = {
        'what': model.heading,
        'label': 'synthetic truth: solid finite elements, no code shared with the shell solver',
        'solver': f'CalculiX CrunchiX {calculix.solver_version()}, C3D20R, NLGEOM',
        **model.meta,
        'thickness_m': round(solid.thickness * 1e-3, 9),
        'contacts': [
            {
                'centre_m': np.round(np.array(contact.centre) * 1e-3, 9).tolist(),
                'direction': np.round(contact.direction, 12).tolist(),
                'radius_m': contact.radius * 1e-3,
                'pin': contact.kind,
            }
            for contact in model.contacts
        ],
        'mesh': {'nodes': len(solid.positions), 'elements': len(solid.elements)},
        'levels': [
            {
                'force_n': round(float(force), 6),
                'gas_gauge_pressure_pa': round(float(history.pressures[level]) * 1e6, 3),
                'volume_ratio': round(float(history.volumes[level]) / history.rest_volume, 9),
                'middle_displacement_m': np.round(middle[level], 9).tolist(),
                'outer_displacement_m': np.round(top[level], 9).tolist(),
            }
            for level, force in enumerate(history.forces)
        ],
    }
    (FOLDER / f'{name}.json').write_text(compact_json(found))
    calculix.keep_deck(history.deck, FOLDER / f'{name}.inp.gz')


def compact_json(found: dict) -> str:
    """JSON with one line per entry and per load level, so that differences stay readable."""
    head = {key: value for key, value in found.items() if key != 'levels'}
    lines = [f' {json.dumps(key)}: {json.dumps(value)},' for key, value in head.items()]
    levels = ',\n  '.join(json.dumps(level) for level in found['levels'])
    return '{\n' + '\n'.join(lines) + f'\n "levels": [\n  {levels}\n ]\n}}\n'
