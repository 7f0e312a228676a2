# SPDX-License-Identifier: Apache-2.0
"""The live estimator: a fast tick in the node, the nonlinear solver in a process of its own."""
