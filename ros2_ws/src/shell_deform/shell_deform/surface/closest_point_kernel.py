"""Newton projection of points onto a limit surface; one numba kernel, serial, without the GIL."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import types

from shell_deform.compiled.kernel_arrays import float_rows, floats
from shell_deform.compiled.kernel_types import (
    Bools,
    FixedFloatRows,
    FixedLongs,
    Float,
    FloatBlocks,
    FloatRows,
    Floats,
    Int,
    LongRows,
    Longs,
    Void,
    kernel,
)

from .closest_point_plain import (
    HALVINGS,
    LEAST_BEND,
    MAXIMUM_STEPS,
    ON_EDGE,
    ROUND_OFF_STEP,
    STEP_TOLERANCE,
    SURE_BEND,
)

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

# Control points, polynomials, patch and first node of each triangle, nodes; then by patch: sizes,
# halvings, children, their matrices, the matrix of the polynomial; all matrices.
SURFACE = (
    FixedFloatRows, FloatBlocks, FixedLongs, FixedLongs, Longs,
    Longs, Longs, LongRows, LongRows, Longs, Floats,
)  # fmt: skip


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


@kernel(Void, Int, Float, Float, FloatRows, FloatRows, FloatRows, *SURFACE)
def evaluate_triangle(
    triangle: int,
    u: float,
    v: float,
    out: FloatArray,
    x: FloatArray,
    y: FloatArray,
    control_points: FloatArray,
    polynomials: FloatArray,
    patch: IntArray,
    node_offsets: IntArray,
    nodes: IntArray,
    sizes: IntArray,
    halvings: IntArray,
    child: IntArray,
    child_offset: IntArray,
    polynomial_offset: IntArray,
    matrices: FloatArray,
) -> None:
    """Fill out (6, 3) with the surface and its derivatives; x, y are work space (size, 3)."""
    current = patch[triangle]
    if polynomial_offset[current] >= 0:
        evaluate_polynomial(polynomials[triangle], u, v, out)
        return
    start = node_offsets[triangle]
    for i in range(sizes[current]):
        node = nodes[start + i]
        for k in range(3):
            x[i, k] = control_points[node, k]
    scale, depth, deepest = 1.0, 0, halvings[current]
    wanted_u, wanted_v, wanted_scale = 0.0, 0.0, 1.0
    while polynomial_offset[current] < 0:
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
        apply_matrix(matrices, child_offset[current, piece], sizes[inner], sizes[current], x, y)
        for i in range(sizes[inner]):
            for k in range(3):
                x[i, k] = y[i, k]
        current = inner
        scale *= factor
        depth += 1
    apply_matrix(matrices, polynomial_offset[current], 15, sizes[current], x, y)
    evaluate_polynomial(y, u, v, out)
    for k in range(3):
        out[1, k] *= scale
        out[2, k] *= scale
        out[3, k] *= scale * scale
        out[4, k] *= scale * scale
        out[5, k] *= scale * scale
        out[0, k] += (wanted_u * out[1, k] + wanted_v * out[2, k]) / wanted_scale


@kernel(types.Tuple((Float, Int)), Float, Float, Float, Float)
def leave_share(u: float, v: float, du: float, dv: float) -> tuple[float, int]:
    """How much of a step stays in the triangle (0..1), and the edge through which it leaves."""
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
    return share, edge


@kernel(
    Void, FixedFloatRows, Longs, FloatRows, FloatRows, FloatRows, Bools, Bools, Longs, *SURFACE,
    called_from_python=True,
)  # fmt: skip
def project_points(
    queries: FloatArray,
    triangle: IntArray,
    parameters: FloatArray,
    position: FloatArray,
    normal: FloatArray,
    on_boundary: BoolArray,
    sure: BoolArray,
    neighbour: IntArray,
    control_points: FloatArray,
    polynomials: FloatArray,
    patch: IntArray,
    node_offsets: IntArray,
    nodes: IntArray,
    sizes: IntArray,
    halvings: IntArray,
    child: IntArray,
    child_offset: IntArray,
    polynomial_offset: IntArray,
    matrices: FloatArray,
) -> None:
    """Move each seed (triangle, parameters), in place, to the foot point of its query.

    Also fills position (q, 3), normal (q, 3), on_boundary (q,), and sure (q,): False where
    another foot nearby may be nearer.
    """
    largest = 15
    for size in sizes:
        largest = max(largest, size)
    x, y = float_rows(largest, 3), float_rows(largest, 3)
    here, there = float_rows(6, 3), float_rows(6, 3)
    r = floats(3, 0.0)
    for q in range(len(queries)):
        t, u, v = triangle[q], parameters[q, 0], parameters[q, 1]
        evaluate_triangle(
            t, u, v, here, x, y, control_points, polynomials, patch, node_offsets, nodes,
            sizes, halvings, child, child_offset, polynomial_offset, matrices,
        )  # fmt: skip
        at_end = False
        stuck = False
        converged = False
        came_from = -1
        squared, area, bend = 0.0, 0.0, 0.0
        for _ in range(MAXIMUM_STEPS):
            squared, gu, gv = 0.0, 0.0, 0.0
            guu, guv, gvv, huu, huv, hvv = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            for k in range(3):
                r[k] = here[0, k] - queries[q, k]
                squared += r[k] * r[k]
                gu += r[k] * here[1, k]
                gv += r[k] * here[2, k]
                guu += here[1, k] * here[1, k]
                guv += here[1, k] * here[2, k]
                gvv += here[2, k] * here[2, k]
                huu += r[k] * here[3, k]
                huv += r[k] * here[4, k]
                hvv += r[k] * here[5, k]
            huu, huv, hvv = guu + huu, guv + huv, gvv + hvv
            area = guu * gvv - guv * guv
            # Bends of the squared distance along the surface, over those of a plane's.
            mean = 0.5 * (gvv * huu - 2.0 * guv * huv + guu * hvv) / area
            bend = mean - np.sqrt(max(0.0, mean * mean - (huu * hvv - huv * huv) / area))
            if stuck:
                muu, muv, mvv = guu, guv, gvv
            else:
                lift = max(abs(bend), LEAST_BEND) - bend
                muu, muv, mvv = huu + lift * guu, huv + lift * guv, hvv + lift * gvv
            determinant = muu * mvv - muv * muv
            at_end = False
            du = -(mvv * gu - muv * gv) / determinant
            dv = -(muu * gv - muv * gu) / determinant
            share, edge = leave_share(u, v, du, dv)
            if edge >= 0 and share < ON_EDGE:
                twin = neighbour[3 * t + edge]
                if twin < 0 or twin // 3 == came_from:
                    # Pushed outward on the edge of the surface, or from both sides onto an edge
                    # inside it: slide along that edge.
                    at_end = twin < 0
                    eu, ev = (
                        (1.0, 0.0) if edge == 0 else ((-1.0, 1.0) if edge == 1 else (0.0, -1.0))
                    )
                    slope = gu * eu + gv * ev
                    plain = guu * eu * eu + 2.0 * guv * eu * ev + gvv * ev * ev
                    along = huu * eu * eu + 2.0 * huv * eu * ev + hvv * ev * ev
                    along = max(abs(along), LEAST_BEND * plain)
                    du, dv = -slope / along * eu, -slope / along * ev
                    share, edge = leave_share(u, v, du, dv)
                    if edge >= 0 and share < ON_EDGE and neighbour[3 * t + edge] < 0:
                        at_end, converged = True, True
                        break
            if du * du + dv * dv < STEP_TOLERANCE * STEP_TOLERANCE:
                converged = True
                break
            if edge >= 0 and share < ON_EDGE:
                twin = neighbour[3 * t + edge]
                back = v if edge == 2 else (1.0 - u if edge == 0 else 1.0 - v)
                came_from = t
                t, corner = twin // 3, twin % 3
                if corner == 0:
                    u, v = back, 0.0
                elif corner == 1:
                    u, v = 1.0 - back, back
                else:
                    u, v = 0.0, 1.0 - back
                stuck = True
                evaluate_triangle(
                    t, u, v, here, x, y, control_points, polynomials, patch, node_offsets,
                    nodes, sizes, halvings, child, child_offset, polynomial_offset, matrices,
                )  # fmt: skip
                continue
            taken = share
            accepted = False
            for _halving in range(HALVINGS):
                nu, nv = u + taken * du, v + taken * dv
                if taken == share and edge == 0:
                    nv = 0.0
                elif taken == share and edge == 2:
                    nu = 0.0
                elif taken == share and edge == 1:
                    nv = 1.0 - nu
                nu, nv = min(max(nu, 0.0), 1.0), min(max(nv, 0.0), 1.0)
                evaluate_triangle(
                    t, nu, nv, there, x, y, control_points, polynomials, patch, node_offsets,
                    nodes, sizes, halvings, child, child_offset, polynomial_offset, matrices,
                )  # fmt: skip
                trial = 0.0
                for k in range(3):
                    trial += (there[0, k] - queries[q, k]) ** 2
                if trial <= squared * (1.0 + 1e-15) + 1e-300:
                    accepted = True
                    break
                taken *= 0.5
            if not accepted:
                if stuck:
                    converged = du * du + dv * dv < ROUND_OFF_STEP * ROUND_OFF_STEP
                    break
                stuck = True
                continue
            stuck = False
            came_from = -1
            small = (nu - u) ** 2 + (nv - v) ** 2 < STEP_TOLERANCE * STEP_TOLERANCE
            u, v = nu, nv
            for i in range(6):
                for k in range(3):
                    here[i, k] = there[i, k]
            if small and edge < 0:
                converged = True
                break
        triangle[q], parameters[q, 0], parameters[q, 1] = t, u, v
        on_boundary[q] = at_end
        sure[q] = converged and not at_end and bend > SURE_BEND
        a = here[1, 1] * here[2, 2] - here[1, 2] * here[2, 1]
        b = here[1, 2] * here[2, 0] - here[1, 0] * here[2, 2]
        c = here[1, 0] * here[2, 1] - here[1, 1] * here[2, 0]
        length = np.sqrt(a * a + b * b + c * c)
        for k in range(3):
            position[q, k] = here[0, k]
        normal[q, 0], normal[q, 1], normal[q, 2] = a / length, b / length, c / length
