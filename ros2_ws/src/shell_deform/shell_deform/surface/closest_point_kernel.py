# SPDX-License-Identifier: Apache-2.0
"""Newton projection of points onto a limit surface; one numba kernel, serial, without the GIL."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from numba import types

from shell_deform.compiled.kernel_arrays import float_rows
from shell_deform.compiled.kernel_types import (
    Bool,
    Bools,
    FixedFloatRows,
    Float,
    FloatBlocks,
    FloatRows,
    Floats,
    Int,
    LongRows,
    Longs,
    Void,
    kernel,
    named,
)

from .closest_point_types import (
    HALVINGS,
    LEAST_BEND,
    MAXIMUM_STEPS,
    ON_EDGE,
    ROUND_OFF_STEP,
    STEP_TOLERANCE,
    SURE_BEND,
    Feet,
    Patches,
)

FloatArray = npt.NDArray[np.float64]


class Work(NamedTuple):
    """Work space: the control points of a patch, and those of a child."""

    nodes: Any
    finer: Any


class Place(NamedTuple):
    """A point of the surface: its triangle, and its parameters there."""

    triangle: Any
    u: Any
    v: Any


class Step(NamedTuple):
    """A step in the parameters, the share of it that stays in the triangle, and the edge where it
    leaves (-1 where it does not)."""

    du: Any
    dv: Any
    share: Any
    edge: Any


class Expansion(NamedTuple):
    """Half the squared distance about a point: gradient g, metric m, second derivative h.

    `bend`: the least second derivative along the surface over that of a plane, which is m.
    """

    squared: Any
    gu: Any
    gv: Any
    muu: Any
    muv: Any
    mvv: Any
    huu: Any
    huv: Any
    hvv: Any
    bend: Any


PATCHES = named(
    Patches,
    patch=Longs,
    node_offsets=Longs,
    nodes=Longs,
    neighbour=Longs,
    sizes=Longs,
    halvings=Longs,
    child=LongRows,
    child_offset=LongRows,
    polynomial_offset=Longs,
    matrices=Floats,
)
FEET = named(
    Feet,
    triangle=Longs,
    parameters=FloatRows,
    position=FloatRows,
    normal=FloatRows,
    on_boundary=Bools,
    sure=Bools,
)
WORK = named(Work, **dict.fromkeys(Work._fields, FloatRows))
POINT = types.UniTuple(Float, 3)
PLACE = named(Place, triangle=Int, u=Float, v=Float)
STEP = named(Step, du=Float, dv=Float, share=Float, edge=Int)
EXPANSION = named(Expansion, **dict.fromkeys(Expansion._fields, Float))


@kernel(Void, FloatRows, Float, Float, FloatRows)
def evaluate_polynomial(c: FloatArray, u: float, v: float, out: FloatArray) -> None:
    """Fill out (6, 3) with value, u, v, uu, uv, vv derivative of a quartic with (15, 3) terms."""
    u2, v2, uv = u * u, v * v, u * v
    u3, v3 = u2 * u, v2 * v
    for k in range(3):
        out[0, k] = (
            c[0, k] + u * c[1, k] + v * c[2, k] + u2 * c[3, k] + uv * c[4, k] + v2 * c[5, k]
            + u3 * c[6, k] + u2 * v * c[7, k] + u * v2 * c[8, k] + v3 * c[9, k]
            + u3 * u * c[10, k] + u3 * v * c[11, k] + u2 * v2 * c[12, k]
            + u * v3 * c[13, k] + v3 * v * c[14, k]
        )  # fmt: skip
        out[1, k] = (
            c[1, k] + 2.0 * u * c[3, k] + v * c[4, k] + 3.0 * u2 * c[6, k]
            + 2.0 * uv * c[7, k] + v2 * c[8, k] + 4.0 * u3 * c[10, k]
            + 3.0 * u2 * v * c[11, k] + 2.0 * u * v2 * c[12, k] + v3 * c[13, k]
        )  # fmt: skip
        out[2, k] = (
            c[2, k] + u * c[4, k] + 2.0 * v * c[5, k] + u2 * c[7, k]
            + 2.0 * uv * c[8, k] + 3.0 * v2 * c[9, k] + u3 * c[11, k]
            + 2.0 * u2 * v * c[12, k] + 3.0 * u * v2 * c[13, k] + 4.0 * v3 * c[14, k]
        )  # fmt: skip
        out[3, k] = (
            2.0 * c[3, k] + 6.0 * u * c[6, k] + 2.0 * v * c[7, k]
            + 12.0 * u2 * c[10, k] + 6.0 * uv * c[11, k] + 2.0 * v2 * c[12, k]
        )  # fmt: skip
        out[4, k] = (
            c[4, k] + 2.0 * u * c[7, k] + 2.0 * v * c[8, k]
            + 3.0 * u2 * c[11, k] + 4.0 * uv * c[12, k] + 3.0 * v2 * c[13, k]
        )  # fmt: skip
        out[5, k] = (
            2.0 * c[5, k] + 2.0 * u * c[8, k] + 6.0 * v * c[9, k]
            + 2.0 * u2 * c[12, k] + 6.0 * uv * c[13, k] + 12.0 * v2 * c[14, k]
        )  # fmt: skip


@kernel(Void, Floats, Int, Int, Int, FloatRows, FloatRows)
def apply_matrix(
    matrices: FloatArray, start: int, rows: int, columns: int, x: FloatArray, out: FloatArray
) -> None:
    """Fill out (rows, 3) with the (rows, columns) matrix at `start` times x (columns, 3)."""
    for i in range(rows):
        row = matrices[start + i * columns : start + (i + 1) * columns]
        a, b, c = 0.0, 0.0, 0.0
        for j in range(columns):
            weight = row[j]
            a += weight * x[j, 0]
            b += weight * x[j, 1]
            c += weight * x[j, 2]
        out[i, 0], out[i, 1], out[i, 2] = a, b, c


@kernel(Void, PLACE, FixedFloatRows, PATCHES, WORK, FloatRows)
def evaluate_irregular(
    place: Any, control_points: FloatArray, patches: Any, work: Any, out: FloatArray
) -> None:
    """The same where the patch is split until the point lies in a regular one."""
    sizes, child, matrices = patches.sizes, patches.child, patches.matrices
    triangle, u, v = place
    x, y = work.nodes, work.finer
    current = patches.patch[triangle]
    start = patches.node_offsets[triangle]
    for i in range(sizes[current]):
        node = patches.nodes[start + i]
        for k in range(3):
            x[i, k] = control_points[node, k]
    scale, depth, deepest = 1.0, 0, patches.halvings[current]
    wanted_u, wanted_v, wanted_scale = 0.0, 0.0, 1.0
    while patches.polynomial_offset[current] < 0:
        if depth == deepest:
            wanted_u, wanted_v, wanted_scale = u, v, scale
            w = 1.0 - u - v
            if w > 0.5:
                total = u + v
                u, v = (0.5 * u / total, 0.5 * v / total) if total > 0.0 else (0.25, 0.25)
            elif u > 0.5:
                total = v + w
                v = 0.5 * v / total if total > 0.0 else 0.25
                u = 0.5
            elif v > 0.5:
                total = u + w
                u = 0.5 * u / total if total > 0.0 else 0.25
                v = 0.5
            wanted_u, wanted_v = wanted_u - u, wanted_v - v
        if u + v < 0.5:
            piece, factor = 0, 2.0
            u, v = 2.0 * u, 2.0 * v
        elif u > 0.5:
            piece, factor = 1, 2.0
            u, v = 2.0 * u - 1.0, 2.0 * v
        elif v > 0.5:
            piece, factor = 2, 2.0
            u, v = 2.0 * u, 2.0 * v - 1.0
        else:
            piece, factor = 3, -2.0
            u, v = 1.0 - 2.0 * u, 1.0 - 2.0 * v
        inner = child[current, piece]
        apply_matrix(
            matrices, patches.child_offset[current, piece], sizes[inner], sizes[current], x, y
        )
        for i in range(sizes[inner]):
            for k in range(3):
                x[i, k] = y[i, k]
        current = inner
        scale *= factor
        depth += 1
    apply_matrix(matrices, patches.polynomial_offset[current], 15, sizes[current], x, y)
    evaluate_polynomial(y, u, v, out)
    for k in range(3):
        out[1, k] *= scale
        out[2, k] *= scale
        out[3, k] *= scale * scale
        out[4, k] *= scale * scale
        out[5, k] *= scale * scale
        out[0, k] += (wanted_u * out[1, k] + wanted_v * out[2, k]) / wanted_scale


@kernel(Void, PLACE, FixedFloatRows, FloatBlocks, PATCHES, WORK, FloatRows, inline=True)
def evaluate_triangle(
    place: Any,
    control_points: FloatArray,
    polynomials: FloatArray,
    patches: Any,
    work: Any,
    out: FloatArray,
) -> None:
    """Fill out (6, 3) with the surface and its derivatives at a place."""
    if patches.polynomial_offset[patches.patch[place.triangle]] >= 0:
        evaluate_polynomial(polynomials[place.triangle], place.u, place.v, out)
    else:
        evaluate_irregular(place, control_points, patches, work, out)


@kernel(STEP, PLACE, Float, Float)
def step_from(place: Any, du: float, dv: float) -> Any:
    """A step with the share of it (0..1) that stays in the triangle, and where it leaves."""
    u, v = place.u, place.v
    share, edge = 1.0, -1
    if v + dv < 0.0:
        share, edge = v / -dv, 0
    if u + du + v + dv > 1.0:
        reach = max(0.0, 1.0 - u - v) / (du + dv)
        if reach < share:
            share, edge = reach, 1
    if u + du < 0.0:
        reach = u / -du
        if reach < share:
            share, edge = reach, 2
    return Step(du, dv, share, edge)


@kernel(Bool, STEP)
def leaves_at_once(step: Any) -> bool:
    """Whether a step from the edge of the triangle leads out of it."""
    return step.edge >= 0 and step.share < ON_EDGE


@kernel(Bool, STEP, Float)
def shorter(step: Any, length: float) -> bool:
    """Whether a step is shorter than that, in the parameters."""
    return step.du * step.du + step.dv * step.dv < length * length


@kernel(EXPANSION, FloatRows, POINT)
def expand(here: FloatArray, query: Any) -> Any:
    """Half the squared distance of a query (3,) about the surface point `here` (6, 3)."""
    squared, gu, gv = 0.0, 0.0, 0.0
    muu, muv, mvv, huu, huv, hvv = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(3):
        r = here[0, k] - query[k]
        squared += r * r
        gu += r * here[1, k]
        gv += r * here[2, k]
        muu += here[1, k] * here[1, k]
        muv += here[1, k] * here[2, k]
        mvv += here[2, k] * here[2, k]
        huu += r * here[3, k]
        huv += r * here[4, k]
        hvv += r * here[5, k]
    huu, huv, hvv = muu + huu, muv + huv, mvv + hvv
    area = muu * mvv - muv * muv
    mean = 0.5 * (mvv * huu - 2.0 * muv * huv + muu * hvv) / area
    bend = mean - np.sqrt(max(0.0, mean * mean - (huu * hvv - huv * huv) / area))
    return Expansion(squared, gu, gv, muu, muv, mvv, huu, huv, hvv, bend)


@kernel(STEP, PLACE, EXPANSION, Bool)
def newton_step(place: Any, about: Any, stuck: bool) -> Any:
    """Newton's step, its bends lifted above zero; where that is `stuck`, Gauss and Newton's."""
    if stuck:
        auu, auv, avv = about.muu, about.muv, about.mvv
    else:
        lift = max(abs(about.bend), LEAST_BEND) - about.bend
        auu, auv = about.huu + lift * about.muu, about.huv + lift * about.muv
        avv = about.hvv + lift * about.mvv
    determinant = auu * avv - auv * auv
    du = -(avv * about.gu - auv * about.gv) / determinant
    dv = -(auu * about.gv - auv * about.gu) / determinant
    return step_from(place, du, dv)


@kernel(STEP, PLACE, EXPANSION, Int)
def slide_along_edge(place: Any, about: Any, edge: int) -> Any:
    """Newton's step along an edge of the triangle."""
    eu, ev = (1.0, 0.0) if edge == 0 else ((-1.0, 1.0) if edge == 1 else (0.0, -1.0))
    slope = about.gu * eu + about.gv * ev
    plain = about.muu * eu * eu + 2.0 * about.muv * eu * ev + about.mvv * ev * ev
    along = about.huu * eu * eu + 2.0 * about.huv * eu * ev + about.hvv * ev * ev
    along = max(abs(along), LEAST_BEND * plain)
    return step_from(place, -slope / along * eu, -slope / along * ev)


@kernel(PLACE, PLACE, Int, Int)
def cross_edge(place: Any, edge: int, twin: int) -> Any:
    """The same point in the triangle on the other side, whose half-edge `twin` is."""
    back = place.v if edge == 2 else (1.0 - place.u if edge == 0 else 1.0 - place.v)
    triangle, corner = twin // 3, twin % 3
    if corner == 0:
        return Place(triangle, back, 0.0)
    if corner == 1:
        return Place(triangle, 1.0 - back, back)
    return Place(triangle, 0.0, 1.0 - back)


@kernel(PLACE, PLACE, STEP, Float)
def stepped(place: Any, step: Any, taken: float) -> Any:
    """The place after a share of a step, exactly on the edge where it goes as far as that."""
    u, v = place.u + taken * step.du, place.v + taken * step.dv
    if taken == step.share and step.edge == 0:
        v = 0.0
    elif taken == step.share and step.edge == 2:
        u = 0.0
    elif taken == step.share and step.edge == 1:
        v = 1.0 - u
    return Place(place.triangle, min(max(u, 0.0), 1.0), min(max(v, 0.0), 1.0))


@kernel(Float, FloatRows, POINT)
def squared_distance(here: FloatArray, query: Any) -> float:
    """Of a query from the surface point `here` (6, 3)."""
    total = 0.0
    for k in range(3):
        total += (here[0, k] - query[k]) ** 2
    return total


@kernel(Void, FloatRows, FloatRows)
def copy_point(there: FloatArray, here: FloatArray) -> None:
    """Fill `here` (6, 3) with `there`."""
    for i in range(6):
        for k in range(3):
            here[i, k] = there[i, k]


@kernel(Void, FEET, Int, PLACE, FloatRows)
def write_foot(feet: Any, q: int, place: Any, here: FloatArray) -> None:
    """Enter the place of foot q, its position and its normal."""
    feet.triangle[q] = place.triangle
    feet.parameters[q, 0], feet.parameters[q, 1] = place.u, place.v
    a = here[1, 1] * here[2, 2] - here[1, 2] * here[2, 1]
    b = here[1, 2] * here[2, 0] - here[1, 0] * here[2, 2]
    c = here[1, 0] * here[2, 1] - here[1, 1] * here[2, 0]
    length = np.sqrt(a * a + b * b + c * c)
    for k in range(3):
        feet.position[q, k] = here[0, k]
    feet.normal[q, 0], feet.normal[q, 1] = a / length, b / length
    feet.normal[q, 2] = c / length


@kernel(Void, FixedFloatRows, FEET, FixedFloatRows, FloatBlocks, PATCHES, called_from_python=True)
def project_points(
    queries: FloatArray,
    feet: Any,
    control_points: FloatArray,
    polynomials: FloatArray,
    patches: Any,
) -> None:
    """Move each seed (triangle and parameters of `feet`) to the foot of its query (q, 3).

    Fills the rest of `feet`. Tuples of arrays go no deeper than one call from here: passing them
    costs as much as evaluating a polynomial.
    """
    largest = 15
    for size in patches.sizes:
        largest = max(largest, size)
    here, there = float_rows(6, 3), float_rows(6, 3)
    work = Work(float_rows(largest, 3), float_rows(largest, 3))
    neighbour = patches.neighbour
    for q in range(len(queries)):
        query = (queries[q, 0], queries[q, 1], queries[q, 2])
        place = Place(feet.triangle[q], feet.parameters[q, 0], feet.parameters[q, 1])
        evaluate_triangle(place, control_points, polynomials, patches, work, here)
        at_end, stuck, converged, came_from, bend = False, False, False, -1, 0.0
        for _ in range(MAXIMUM_STEPS):
            about = expand(here, query)
            bend = about.bend
            step = newton_step(place, about, stuck)
            at_end = False
            if leaves_at_once(step):
                twin = neighbour[3 * place.triangle + step.edge]
                if twin < 0 or twin // 3 == came_from:
                    # Pushed outward on the edge of the surface, or from both sides onto an edge
                    # inside it.
                    step = slide_along_edge(place, about, step.edge)
                    at_end = twin < 0
                    if leaves_at_once(step) and neighbour[3 * place.triangle + step.edge] < 0:
                        at_end, converged = True, True
                        break
            if shorter(step, STEP_TOLERANCE):
                converged = True
                break
            if leaves_at_once(step):
                came_from = place.triangle
                place = cross_edge(place, step.edge, neighbour[3 * came_from + step.edge])
                stuck = True
                evaluate_triangle(place, control_points, polynomials, patches, work, here)
                continue
            taken, accepted, new = step.share, False, place
            for _halving in range(HALVINGS):
                new = stepped(place, step, taken)
                evaluate_triangle(new, control_points, polynomials, patches, work, there)
                if squared_distance(there, query) <= about.squared * (1.0 + 1e-15) + 1e-300:
                    accepted = True
                    break
                taken *= 0.5
            if not accepted:
                if stuck:
                    converged = shorter(step, ROUND_OFF_STEP)
                    break
                stuck = True
                continue
            stuck, came_from = False, -1
            moved = Step(new.u - place.u, new.v - place.v, 1.0, -1)
            place = new
            copy_point(there, here)
            if step.edge < 0 and shorter(moved, STEP_TOLERANCE):
                converged = True
                break
        feet.on_boundary[q] = at_end
        feet.sure[q] = converged and not at_end and bend > SURE_BEND
        write_foot(feet, q, place, here)
