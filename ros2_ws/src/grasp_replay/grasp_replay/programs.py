# SPDX-License-Identifier: Apache-2.0
# PYTHON_ARGCOMPLETE_OK
"""The console scripts of the package; nothing is imported before one is called."""

from __future__ import annotations

from grasp_common.command_line import command

replay = command('replay', 'grasp_replay.replay_node', usage='grasp_replay.replay_options')
record = command('record', 'grasp_replay.record_node', usage='grasp_replay.record_options')
grasp_report = command('grasp_report', 'grasp_replay.commands.grasp_report')
bag_check = command('bag_check', 'grasp_replay.commands.bag_check')
