# SPDX-License-Identifier: Apache-2.0
# PYTHON_ARGCOMPLETE_OK
"""The console scripts of the package; nothing is imported before one is called."""

from __future__ import annotations

from grasp_common.command_line import command

hand_bridge = command(
    'hand_bridge', 'barrett_hand_bridge.hand_bridge_node', usage='barrett_hand_bridge.parameters'
)
hand_emulator = command('hand_emulator', 'barrett_hand_bridge.commands.hand_emulator')
hand_calibrate = command('hand_calibrate', 'barrett_hand_bridge.commands.hand_calibrate')
