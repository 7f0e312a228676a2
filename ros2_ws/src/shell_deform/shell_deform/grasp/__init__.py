# SPDX-License-Identifier: Apache-2.0
"""Whether a grasp holds, how much, until when: pure functions of points, normals, forces."""
