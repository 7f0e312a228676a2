# SPDX-License-Identifier: Apache-2.0
"""Console commands of barrett_hand_bridge."""
