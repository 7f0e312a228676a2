# SPDX-License-Identifier: Apache-2.0
"""The gauge of the transition against the truth, on random shells.

Every shell is a random sphere, ellipsoid or closed cylinder (R/h 10-100, Poisson's ratio,
pressure, pin radius) squeezed by two opposite pins to four depths. The truth is the difference of
the linear and the converged nonlinear displacement field under the same forces; the prediction is
what the live tick computes. `main` prints how both agree, the depth at which linear theory is
wrong by 5 and 10 %, and where the prediction fails.

    python tests/benchmarks/linearity.py                       # 24 shells, a minute
    python tests/benchmarks/linearity.py --shells 1000 --results shells.jsonl
    python tests/benchmarks/linearity.py --results shells.jsonl --report docs/linearity.md
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from figures import show

from shell_deform.building import build_model
from shell_deform.live.background.condensed import contact_rows
from shell_deform.live.background.small_loads import pair_products, small_loads
from shell_deform.live.background.tracked_state import Target
from shell_deform.live.background.tracking import EquilibriumTracker
from shell_deform.live.tick.linearity import linear_error
from shell_deform.objects.shell_object import Cylinder, Ellipsoid, Gas, ShellObject, Sphere

RADIUS = 0.03
LIMITS = (0.05, 0.10)
MODULUS = 1e6


def random_shell(generator: np.random.Generator) -> dict[str, object]:
    """Numbers of one shell and where it is pinched."""
    kind = str(generator.choice(['sphere', 'ellipsoid', 'cylinder'], p=[0.5, 0.25, 0.25]))
    slenderness = float(np.exp(generator.uniform(np.log(10.0), np.log(100.0))))
    shape = [float(v) for v in generator.uniform(0.7, 1.4, 2)]
    thickness = RADIUS / slenderness
    curved = np.sqrt(RADIUS * thickness)
    pressure = 0.0
    if generator.random() < 0.4:
        # Membrane strain p R (1 - nu) / (2 E h) up to one percent.
        pressure = float(generator.uniform(0.0, 0.01) * 2.0 * MODULUS * thickness / RADIUS)
    return {
        'kind': kind,
        'slenderness': slenderness,
        'shape': shape,
        'poisson': float(generator.uniform(0.0, 0.5)),
        'pressure_pa': pressure,
        'pin': float(generator.uniform(0.15, 1.0) * curved),
        'depths': [0.06, 0.14, 0.3, float(np.exp(generator.uniform(np.log(0.03), np.log(3.0))))],
    }


def shell_object(numbers: dict) -> tuple[ShellObject, np.ndarray]:
    """The object, and the two opposite contact points (2, 3) on its outer face."""
    diameter = 2.0 * RADIUS
    first, second = numbers['shape']
    direction = np.array([1.0, 0.0, 0.0])
    if numbers['kind'] == 'sphere':
        surface: Sphere | Ellipsoid | Cylinder = Sphere(diameter)
    elif numbers['kind'] == 'ellipsoid':
        surface = Ellipsoid((diameter, first * diameter, second * diameter))
    else:
        surface = Cylinder(diameter, (1.0 + first) * diameter, 'closed')
    gas = Gas('sealed', numbers['pressure_pa']) if numbers['pressure_pa'] else Gas()
    shell = ShellObject(
        name='random',
        surface=surface,
        thickness_m=RADIUS / numbers['slenderness'],
        young_modulus_pa=MODULUS,
        poisson_ratio=numbers['poisson'],
        gas=gas,
        source='random',
    )
    return shell, RADIUS * np.stack([direction, -direction])


def measure(numbers: dict, vertices: int) -> list[dict[str, float]]:
    """Truth and prediction at every depth of one shell."""
    shell, points = shell_object(numbers)
    model = build_model(
        shell, control_vertices=vertices, refine_at=points, refine_radius=numbers['pin']
    )
    tracker = EquilibriumTracker(model)
    tracker.set_contacts(contact_rows(model, ()), np.zeros(0))
    tracker.advance(tracker.present(np.zeros(0, bool)))
    unloaded, base = tracker.positions, tracker.state.moved
    rows = contact_rows(model, tuple(model.contact(p, numbers['pin']) for p in points))
    system = tracker.rest_system(unloaded, rows)
    small = small_loads(model, unloaded, system, rows)
    tracker.set_contacts(rows, np.zeros(2))
    start = tracker.present(np.ones(2, bool))
    found = []
    for depth in sorted(numbers['depths']):
        wanted = start.displacement + depth * shell.thickness_m
        target = Target(start.force, wanted, start.driven, start.rigid, start.held)
        if tracker.advance(target) < 1.0:
            break
        force = tracker.state.force
        moved = (tracker.state.moved - base).reshape(-1, 3)
        linear = (small.fields @ force).reshape(-1, 3)
        size = np.linalg.norm(moved, axis=1).max()
        centre = rows.measure.T @ (tracker.state.moved - base)
        ideal = small.compliance @ force
        curve = small.second_order @ pair_products(force)
        found.append(
            {
                'depth': depth,
                'truth': float(np.linalg.norm(moved - linear, axis=1).max() / size),
                'at_contact': float(abs(centre[0] - ideal[0]) / abs(centre[0])),
                'predicted': linear_error(small.compliance, small.second_order, force, centre),
                'linear_only': linear_error(small.compliance, small.second_order, force),
                'bend': float(curve[0] / ideal[0] ** 2 * shell.thickness_m),
            }
        )
        tracker.condense()
    return found


def run(count: int, seed: int, vertices: int, results: Path) -> None:
    """Measure shells until `results` holds `count` of them, one JSON line each."""
    done = len(results.read_text().splitlines()) if results.exists() else 0
    with results.open('a') as stream:
        for index in range(done, count):
            numbers = random_shell(np.random.default_rng([seed, index]))
            try:
                numbers['found'] = measure(numbers, vertices)
            except (ValueError, RuntimeError, np.linalg.LinAlgError) as error:
                numbers['failed'] = str(error)
            print(json.dumps(numbers), file=stream, flush=True)
            print(f'\r{index + 1} of {count}', end='', file=sys.stderr, flush=True)


def crossing(found: list[dict[str, float]], limit: float) -> float:
    """Depth [wall thicknesses] at which the true error passes `limit`; NaN outside."""
    depth = np.array([0.0] + [f['depth'] for f in found])
    truth = np.array([0.0] + [f['truth'] for f in found])
    for i in range(1, len(depth)):
        if truth[i - 1] < limit <= truth[i]:
            share = (limit - truth[i - 1]) / (truth[i] - truth[i - 1])
            return float(depth[i - 1] + share * (depth[i] - depth[i - 1]))
    return float('nan')


Row = tuple[str, str, str]


def figures(shells: list[dict]) -> list[Row]:
    """Rows (what, value, goal or remark) of everything measured."""
    usable = [s for s in shells if s.get('found')]
    cases = [f for s in usable for f in s['found']]
    truth = np.array([f['truth'] for f in cases])
    rows: list[Row] = [
        ('shells', f'{len(usable)} of {len(shells)}', '1 000'),
        ('cases (shell and depth)', f'{len(cases)}', ''),
    ]
    for name, key in (('with the served depth', 'predicted'), ('linear only', 'linear_only')):
        guess = np.array([f[key] for f in cases])
        for limit in LIMITS:
            right = (guess > limit) == (truth > limit)
            clear = (truth < 0.8 * limit) | (truth > 1.25 * limit)
            rows.append(
                (
                    f'{100 * limit:.0f} % classified, {name}',
                    f'{100 * right.mean():.1f} %',
                    f'{100 * right[clear].mean():.1f} % where truth is 20 % off the limit',
                )
            )
        near = (truth > 0.02) & (truth < 0.3)
        ratio = guess[near] / truth[near]
        rows.append(
            (
                f'predicted / true, 2-30 %, {name}',
                f'{np.median(ratio):.3f}',
                'percentiles 5-95: '
                + ' - '.join(f'{v:.2f}' for v in np.percentile(ratio, [5, 95])),
            )
        )
    for limit in LIMITS:
        groups: list[tuple[str, Callable[[dict], bool]]] = [
            ('all without pressure', lambda s: not s['pressure_pa']),
            ('spheres without pressure', lambda s: not s['pressure_pa'] and s['kind'] == 'sphere'),
            (
                'ellipsoids without pressure',
                lambda s: not s['pressure_pa'] and s['kind'] == 'ellipsoid',
            ),
            (
                'cylinders without pressure',
                lambda s: not s['pressure_pa'] and s['kind'] == 'cylinder',
            ),
            ('under pressure', lambda s: bool(s['pressure_pa'])),
        ]
        for name, chosen in groups:
            depth = np.array([crossing(s['found'], limit) for s in usable if chosen(s)])
            depth = depth[np.isfinite(depth)]
            if len(depth) > 2:
                low, middle, high = np.percentile(depth, [5, 50, 95])
                rows.append(
                    (
                        f'critical depth at {100 * limit:.0f} %, {name}',
                        f'{middle:.3f} h',
                        f'5-95: {low:.3f} - {high:.3f} h',
                    )
                )
    return rows


def law(shells: list[dict], limit: float) -> tuple[np.ndarray, float]:
    """Least-squares exponents of the critical depth of spheres: c (R/h)^a (1 + pin/l)^b tau."""
    rows, values = [], []
    for s in shells:
        depth = crossing(s.get('found') or [], limit)
        if s['kind'] != 'sphere' or not np.isfinite(depth):
            continue
        thickness = RADIUS / s['slenderness']
        stiff = MODULUS * thickness / RADIUS
        rows.append(
            [
                1.0,
                np.log(s['slenderness']),
                s['pin'] / np.sqrt(RADIUS * thickness),
                s['pressure_pa'] / (2 * stiff) * s['slenderness'],
                s['poisson'],
            ]
        )
        values.append(np.log(depth))
    design, right = np.array(rows), np.array(values)
    answer = np.linalg.lstsq(design, right, rcond=None)[0]
    return answer, float(np.std(design @ answer - right))


def report(shells: list[dict]) -> str:
    """Everything as Markdown."""
    lines = [
        '# The gauge of the transition from linear to nonlinear theory',
        '',
        '`python tests/benchmarks/linearity.py` measured these figures; the module says how.',
        '',
        '| what | value | remark |',
        '|---|---|---|',
    ]
    lines += [f'| {a} | {b} | {c} |' for a, b, c in figures(shells)]
    lines += [
        '',
        '## Law of the critical depth',
        '',
        'For spheres, with the wall h, the pin radius a, l = sqrt(R h) and the membrane '
        'strain e0 = p R / (2 E h) of the unloaded shell:',
        '',
        '    w_crit / h = c (R/h)^n exp(k a / l + m e0 R / h + q nu)',
        '',
        '| error | c | n | k | m | q | scatter (1 sigma) |',
        '|---|---|---|---|---|---|---|',
    ]
    for limit in LIMITS:
        answer, scatter = law(shells, limit)
        lines.append(
            f'| {100 * limit:.0f} % | {np.exp(answer[0]):.4f} | '
            + ' | '.join(f'{v:+.3f}' for v in answer[1:])
            + f' | {100 * scatter:.0f} % |'
        )
    worst = sorted(
        (
            (abs(np.log(f['predicted'] / f['truth'])), s, f)
            for s in shells
            for f in s.get('found') or []
            if 0.03 < f['truth'] < 0.3
        ),
        key=lambda entry: -entry[0],
    )[:8]
    lines += [
        '',
        '## Where it fails',
        '',
        'The worst cases with a true error of 3-30 %:',
        '',
        '| shape | R/h | nu | p [Pa] | a / l | depth / h | true | predicted |',
        '|---|---|---|---|---|---|---|---|',
    ]
    for _, s, f in worst:
        reach = np.sqrt(RADIUS * RADIUS / s['slenderness'])
        lines.append(
            f'| {s["kind"]} | {s["slenderness"]:.0f} | {s["poisson"]:.2f} | '
            f'{s["pressure_pa"]:.0f} | {s["pin"] / reach:.2f} | {f["depth"]:.2f} | '
            f'{100 * f["truth"]:.1f} % | {100 * f["predicted"]:.1f} % |'
        )
    return '\n'.join(lines) + '\n'


def main() -> int:
    """Run or report; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        '--shells', type=int, help='measure until so many are there (without --results: 24)'
    )
    parser.add_argument('--seed', type=int, default=4)
    parser.add_argument('--vertices', type=int, default=320, help='control vertices of a shell')
    parser.add_argument('--results', type=Path, metavar='FILE', help='keep the shells here')
    parser.add_argument('--report', type=Path, help='write the Markdown table here')
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        results = options.results or Path(folder) / 'shells.jsonl'
        wanted = options.shells or (0 if options.results else 24)
        if wanted:
            run(wanted, options.seed, options.vertices, results)
        shells = [json.loads(line) for line in results.read_text().splitlines()]
    show(figures(shells))
    if options.report:
        options.report.write_text(report(shells))
    return 0


if __name__ == '__main__':
    sys.exit(main())
