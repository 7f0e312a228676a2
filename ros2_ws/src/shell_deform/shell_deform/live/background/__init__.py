# SPDX-License-Identifier: Apache-2.0
"""The process beside the node: it follows the newest load case with the nonlinear solver."""
