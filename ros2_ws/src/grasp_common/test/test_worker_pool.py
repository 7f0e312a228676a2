# SPDX-License-Identifier: Apache-2.0
"""Workers that share work end with whoever started them."""

import os
import signal
import subprocess
import sys

import pytest
from tests.processes import living

POOL = """
import os, time
from grasp_common.worker_pool import worker_pool

if __name__ == '__main__':
    with worker_pool(1) as pool:
        print(pool.submit(os.getpid).result(), flush=True)
        for future in [pool.submit(time.sleep, 600) for _ in range(9)]:
            future.result()
"""


@pytest.mark.parametrize('to_all', [False, True])
@pytest.mark.parametrize('number', [signal.SIGKILL, signal.SIGINT])
def test_a_worker_ends_with_its_owner(tmp_path, wait_until, number, to_all):
    script = tmp_path / 'pool.py'
    script.write_text(POOL)
    with subprocess.Popen(
        [sys.executable, script],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    ) as owner:
        worker = int(owner.stdout.readline())
        # A terminal interrupts a program with all its workers.
        (os.killpg if to_all else os.kill)(owner.pid, number)
        complaint = owner.stderr.read()
    wait_until(lambda: not living(worker), 10.0)
    assert 'SpawnProcess' not in complaint
