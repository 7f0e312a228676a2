# SPDX-License-Identifier: Apache-2.0
# PYTHON_ARGCOMPLETE_OK
"""The console scripts of the package; nothing is imported before one is called."""

from __future__ import annotations

from grasp_common.command_line import command

grasp_view = command('grasp_view', 'grasp_view.grasp_view_node', usage='grasp_view.parameters')
