# SPDX-License-Identifier: Apache-2.0
"""Live 3-D page of a grasp in the browser."""
