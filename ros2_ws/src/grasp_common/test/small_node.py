# SPDX-License-Identifier: Apache-2.0
"""The smallest node that uses everything of `main_node`, as a program of its own."""

from __future__ import annotations

import sys

from rclpy.node import Node

from grasp_common.main_node import declare, run_node, status_name
from grasp_common.parameter_table import Parameter, usage

PARAMETERS = (Parameter('speed', 1.0, 'how fast (m/s)', 0.0, 5.0),)


class Small(Node):
    def __init__(self) -> None:
        super().__init__('small')
        declare(self, PARAMETERS)
        self.create_timer(0.1, lambda: None)
        print(f'status {status_name(self, "part")}', flush=True)
        print('ready', flush=True)

    def close(self) -> None:
        print('closed', flush=True)


if __name__ == '__main__':
    sys.exit(run_node('small', Small, usage=lambda: usage('small', 'Nothing.', PARAMETERS)))
