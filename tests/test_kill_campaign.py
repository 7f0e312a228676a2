# SPDX-License-Identifier: Apache-2.0
"""Whatever is killed, and whenever: nothing is left running, and no folder behind."""

import os
import random
import signal
import time

import pytest
from tests.processes import descendants, living

MOMENTS = 25 if os.environ.get('SOAK') else 1
NODES = {
    'hand_bridge': (('backend:=emulator', 'initialize_on_start:=true'), 'connected to', 2),
    'deformation': ((), 'building', 1),
    'grasp_view': (('what_if:=true', 'port:=8974'), 'page ready', 2),
    'scan_compare': (('object:=tennis_ball',), '', 0),
}


@pytest.mark.timeout(7200)
@pytest.mark.parametrize('number', [signal.SIGKILL, signal.SIGHUP])
@pytest.mark.parametrize('name', sorted(NODES))
def test_a_node_that_is_ended_at_any_moment_leaves_nothing(
    start, wait_until, tmp_path, name, number
):
    parameters, ready, children = NODES[name]
    arguments = [word for parameter in parameters for word in ('-p', parameter)]
    moments = random.Random(f'{name} {number}')
    for moment in range(MOMENTS):
        folder = tmp_path / f'tmp_{moment}'
        folder.mkdir()
        node = start(name, '--ros-args', *arguments, TMPDIR=str(folder))
        if ready:
            node.wait_for(ready, 120.0)
        wait_until(lambda node=node: len(descendants(node.process.pid)) >= children, 60.0)
        time.sleep(moments.uniform(0.0, 3.0))
        below = descendants(node.process.pid)
        node.process.send_signal(number)
        code = node.ended()
        # A signal that comes before a node has begun ends it as it stands.
        assert code in ((-number,) if number == signal.SIGKILL else (-number, 0)), node.text
        wait_until(lambda below=below: not any(map(living, below)), 10.0)
        wait_until(lambda folder=folder: not list(folder.iterdir()), 10.0, lambda: name)
        assert 'Traceback' not in node.text, node.text
