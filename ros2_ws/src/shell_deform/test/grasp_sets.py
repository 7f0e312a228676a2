# SPDX-License-Identifier: Apache-2.0
"""Random grasps, and the oracles that judge them: linear programmes of other makers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

from shell_deform.grasp.contacts import GraspContacts, contact_wrenches, contacts, size_of

Array = NDArray[np.float64]


def random_grasp(
    rng: np.random.Generator, count: int, friction: float, arm: float = 1e-3, lean: float = 0.3
) -> GraspContacts:
    """Contacts anywhere on a ball of 3 cm, their normals inward but for a lean [rad]."""
    direction = rng.normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    normal = -direction + lean * rng.normal(size=(count, 3))
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    return contacts(0.03 * direction, normal, rng.uniform(5.0, 20.0, count), friction, arm)


def three_pins(friction: float, push: float = 20.0, arm: float = 0.0) -> GraspContacts:
    """Three pins 120 degrees apart on a circle of 3 cm about z."""
    angle = np.radians([0.0, 120.0, 240.0])
    outward = np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    return contacts(0.03 * outward, -outward, push, friction, arm)


def two_pads(friction: float, push: float = 20.0, arm: float = 5e-3) -> GraspContacts:
    """Two flat pads on the z axis, face to face."""
    return contacts(
        np.array([[0.0, 0.0, 0.03], [0.0, 0.0, -0.03]]),
        np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]]),
        push,
        friction,
        arm,
    )


def leaning_pins(angle: float, friction: float, arm: float = 1.3e-3) -> GraspContacts:
    """Two pins on the x axis whose normals lean to the same side by `angle` [rad]."""
    normal = np.array(
        [[-np.cos(angle), -np.sin(angle), 0.0], [np.cos(angle), -np.sin(angle), 0.0]]
    )
    return contacts(np.array([[0.03, 0.0, 0.0], [-0.03, 0.0, 0.0]]), normal, 10.0, friction, arm)


def by_planes(cost: Array, matrix: Array, right: Array, cones: int) -> float:
    """Optimum of a cone programme by HiGHS and planes that touch the cones where it left them."""
    size = len(cost)
    planes = []
    for i in range(cones):
        for part in range(1, 4):
            for side in (1.0, -1.0):
                row = np.zeros(size)
                row[4 * i], row[4 * i + part] = -1.0, side
                planes.append(row)
    bounds = [(None, None)] * (4 * cones) + [(0.0, None)] * (size - 4 * cones)
    for _ in range(200):
        found = linprog(
            cost, np.array(planes), np.zeros(len(planes)), matrix, right, bounds, method='highs'
        )
        assert found.success, found.message
        outside = 0
        for i in range(cones):
            vector = found.x[4 * i + 1 : 4 * i + 4]
            length = np.linalg.norm(vector)
            if length > found.x[4 * i] + 1e-10:
                row = np.zeros(size)
                row[4 * i], row[4 * i + 1 : 4 * i + 4] = -1.0, vector / length
                planes.append(row)
                outside += 1
        if not outside:
            break
    return float(found.fun)


def closed_by_edges(grasp: GraspContacts, edges: int) -> bool:
    """Force closure of point contacts with cones of so many edges: does a squeeze use them all?"""
    size = size_of(grasp)
    basis = contact_wrenches(grasp, grasp.point.mean(axis=0), size)
    assert np.all(grasp.arm == 0.0)
    turn = 2.0 * np.pi * np.arange(edges) / edges
    friction = grasp.friction[None, :, None]
    across = basis[:, :, 1:2] * np.cos(turn) + basis[:, :, 2:3] * np.sin(turn)
    wrench = basis[:, :, :1] + friction * across
    flat = wrench.reshape(6, -1)
    if np.linalg.matrix_rank(flat, 1e-9) < 6:
        return False
    count = flat.shape[1]
    matrix = np.concatenate([flat, np.ones((1, count))])
    matrix = np.concatenate([matrix, matrix.sum(axis=1)[:, None]], axis=1)
    cost = np.append(np.zeros(count), -1.0)
    found = linprog(cost, A_eq=matrix, b_eq=np.append(np.zeros(6), count), method='highs')
    return bool(found.success and found.x[-1] > 1e-9)
