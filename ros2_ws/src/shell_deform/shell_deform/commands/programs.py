# SPDX-License-Identifier: Apache-2.0
# PYTHON_ARGCOMPLETE_OK
"""The console scripts of the package; nothing is imported before one is called."""

from __future__ import annotations

from grasp_common.command_line import command

deformation = command(
    'deformation', 'shell_deform.commands.deformation', usage='shell_deform.node.parameters'
)
shell_solve = command(
    'shell_solve',
    'shell_deform.commands.shell_solve',
    usage='shell_deform.commands.shell_solve_options',
)
shell_verify = command('shell_verify', 'shell_deform.commands.shell_verify')
shell_objects = command(
    'shell_objects',
    'shell_deform.commands.shell_objects',
    usage='shell_deform.commands.shell_objects_options',
)
shell_identify = command(
    'shell_identify',
    'shell_deform.commands.shell_identify',
    usage='shell_deform.commands.shell_identify_options',
)
object_prepare = command(
    'object_prepare',
    'shell_deform.commands.object_prepare',
    usage='shell_deform.commands.object_prepare_options',
)
grasp_map = command(
    'grasp_map',
    'shell_deform.commands.grasp_map',
    usage='shell_deform.commands.grasp_map_options',
)
