# SPDX-License-Identifier: Apache-2.0
"""The pinched ball by Kratos' thin corotational shells; run by an interpreter that has Kratos.

`python kratos_octant.py N WHOLE < forces.json`: an octant of the sphere (N triangles along each
edge), or the whole sphere (WHOLE 1), under the forces [N] per pole of a JSON list, one load step
each, spread evenly over the 2 mm pin. Prints {"depth_mm": […], "iterations": …, "cpu_seconds": …,
"unknowns": …} as the last line.
"""

from __future__ import annotations

import json
import sys
import time
from typing import Any

import KratosMultiphysics as Kratos
import KratosMultiphysics.LinearSolversApplication  # noqa: F401  (registers its solvers)
import KratosMultiphysics.StructuralMechanicsApplication as Structural
import numpy as np
from ball_mesh import POISSON, THICKNESS, YOUNG, octant, pin_weights, sphere
from KratosMultiphysics import python_linear_solver_factory


def run(edge: int, whole: bool, forces: list[float]) -> dict[str, Any]:
    """Solve all load steps."""
    points, triangles = sphere(edge) if whole else octant(edge)
    start = time.process_time()
    model = Kratos.Model()
    part = model.CreateModelPart('ball')
    part.SetBufferSize(2)
    part.ProcessInfo[Kratos.DOMAIN_SIZE] = 3
    for variable in (
        Kratos.DISPLACEMENT, Kratos.ROTATION, Kratos.REACTION, Kratos.REACTION_MOMENT,
        Structural.POINT_LOAD, Kratos.VOLUME_ACCELERATION,
    ):  # fmt: skip
        part.AddNodalSolutionStepVariable(variable)
    material = part.CreateNewProperties(1)
    material[Kratos.YOUNG_MODULUS] = YOUNG
    material[Kratos.POISSON_RATIO] = POISSON
    material[Kratos.THICKNESS] = THICKNESS
    material[Kratos.DENSITY] = 1.0
    material[Kratos.CONSTITUTIVE_LAW] = Structural.LinearElasticPlaneStress2DLaw()
    for i, point in enumerate(points):
        part.CreateNewNode(i + 1, *map(float, point))
    for i, triangle in enumerate(triangles):
        nodes = [int(node) + 1 for node in triangle]
        part.CreateNewElement('ShellThinElementCorotational3D3N', i + 1, nodes, material)
    shares = {1.0: pin_weights(points, triangles)}
    if whole:
        shares[-1.0] = pin_weights(points * [1.0, 1.0, -1.0], triangles[:, ::-1])
    loaded = []
    for sign, weights in shares.items():
        for node in np.flatnonzero(weights):
            part.CreateNewCondition(
                'PointLoadCondition3D1N', len(loaded) + 1, [int(node) + 1], material
            )
            loaded.append((part.Nodes[int(node) + 1], -sign * float(weights[node])))
    utilities = Kratos.VariableUtils()
    for axis in 'XYZ':
        for motion, reaction in (('DISPLACEMENT', 'REACTION'), ('ROTATION', 'REACTION_MOMENT')):
            utilities.AddDof(
                getattr(Kratos, f'{motion}_{axis}'), getattr(Kratos, f'{reaction}_{axis}'), part
            )
    support(part, points, whole)
    for element in part.Elements:
        element.Initialize(part.ProcessInfo)
    linear = python_linear_solver_factory.ConstructSolver(
        Kratos.Parameters('{"solver_type": "LinearSolversApplication.sparse_lu"}')
    )
    strategy = Kratos.ResidualBasedNewtonRaphsonStrategy(
        part,
        Kratos.ResidualBasedIncrementalUpdateStaticScheme(),
        Kratos.ResidualCriteria(1e-6, 1e-9),
        Kratos.ResidualBasedBlockBuilderAndSolver(linear),
        40, False, False, True,
    )  # fmt: skip
    strategy.SetEchoLevel(0)
    strategy.Initialize()
    pole = part.Nodes[int(np.argmax(points[:, 2])) + 1]
    depths, iterations = [], 0
    for step, force in enumerate(forces, 1):
        part.CloneTimeStep(float(step))
        part.ProcessInfo[Kratos.STEP] = step
        for node, share in loaded:
            node.SetSolutionStepValue(Structural.POINT_LOAD, [0.0, 0.0, force * share])
        strategy.Solve()
        iterations += int(part.ProcessInfo[Kratos.NL_ITERATION_NUMBER])
        depths.append(-float(pole.GetSolutionStepValue(Kratos.DISPLACEMENT_Z)))
    return {
        'depth_mm': depths,
        'iterations': iterations,
        'cpu_seconds': time.process_time() - start,
        'unknowns': 6 * len(points),
    }


def support(part: Any, points: np.ndarray, whole: bool) -> None:
    """Symmetry planes of the octant; on the whole ball the same, where they cross it."""
    for plane in range(3):
        names = [f'DISPLACEMENT_{"XYZ"[plane]}']
        names += [f'ROTATION_{"XYZ"[axis]}' for axis in range(3) if axis != plane]
        for i in np.flatnonzero(np.abs(points[:, plane]) < 1e-6):
            for name in names[:1] if whole else names:
                part.Nodes[int(i) + 1].Fix(getattr(Kratos, name))


if __name__ == '__main__':
    print(json.dumps(run(int(sys.argv[1]), sys.argv[2] == '1', json.load(sys.stdin))))
