# SPDX-License-Identifier: Apache-2.0
# PYTHON_ARGCOMPLETE_OK
"""The console scripts of the package; nothing is imported before one is called."""

from __future__ import annotations

from grasp_common.command_line import command

scan_compare = command(
    'scan_compare', 'scan_compare.scan_compare_node', usage='scan_compare.parameters'
)
scan_error = command(
    'scan_error',
    'scan_compare.commands.scan_error',
    usage='scan_compare.commands.scan_error_options',
)
