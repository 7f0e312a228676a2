# SPDX-License-Identifier: Apache-2.0
"""What the grasp packages repeat: clouds, parameters, shutdown, diagnostics, terminal text."""
