# SPDX-License-Identifier: Apache-2.0
"""Figures of the bag tools. `python tests/benchmarks/bags.py [reading memory ...] [--long]`.

`--long` reads a bag of 1 GB, opens a million damaged bags, repairs 100 000, makes 20 reports and
10 live runs, where the short form takes 200 MB, 2 000, 2 000, 3 and 1.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import random
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

ROOT = Path(__file__).parents[2]
BIN = Path(sys.executable).parent
BALL = ROOT / 'bags' / 'tennis_ball_two_finger'
CAN = ROOT / 'bags' / 'half_soda_can'
sys.path += [str(ROOT / 'ros2_ws/src/grasp_replay/test'), str(ROOT / 'tests')]

import bag_mutations  # noqa: E402
import demo  # noqa: E402
from bag_damage import damage, original, recovered, untouched  # noqa: E402
from bag_samples import write_strings  # noqa: E402
from figures import Row, show  # noqa: E402

from grasp_replay.bag_reader import open_bag  # noqa: E402
from grasp_replay.bag_writer import BagWriter  # noqa: E402
from grasp_replay.qos import QosProfile, qos_text  # noqa: E402

MEGABYTE = 2**20
CORES = os.cpu_count() or 1


def wrench_cdr(index: int, nanoseconds: int) -> bytes:
    """A geometry_msgs/WrenchStamped whose force along x counts the messages."""
    header = struct.pack('<iIIB3x', nanoseconds // 10**9, nanoseconds % 10**9, 1, 0)
    return b'\x00\x01\x00\x00' + header + struct.pack('<6d', index, 0, 0, 0, 0, 0)


def write_wrenches(path: Path, count: int, rate_hz: float) -> Path:
    """A bag with one stream of wrenches."""
    with BagWriter(path) as writer:
        topic = writer.add_topic('/w', 'geometry_msgs/msg/WrenchStamped', qos_text(QosProfile()))
        for index in range(count):
            nanoseconds = int(index * 1e9 / rate_hz)
            writer.write(topic, wrench_cdr(index, nanoseconds), nanoseconds)
    return path


def write_clouds(path: Path, megabytes: int) -> Path:
    """A bag of 1.6 MB messages without compression, `megabytes` in all."""
    payload = random.Random(1).randbytes(1_600_000)
    with BagWriter(path, compression='none') as writer:
        topic = writer.add_topic('/scan', 'std_msgs/msg/String')
        for index in range(megabytes * MEGABYTE // len(payload)):
            writer.write(topic, payload, index * 100_000_000)
    return path


def reading(folder: Path) -> Iterator[Row]:
    """Raw messages per second."""
    bag_path = write_wrenches(folder / 'wrenches', 200_000, 1000.0)
    begin = time.perf_counter()
    with open_bag(bag_path) as bag:
        count = sum(1 for _ in bag.messages())
    rate = count / (time.perf_counter() - begin)
    yield Row('reading raw messages', f'{rate:.0f} /s', '>= 50000 /s', rate >= 50_000)


def peak_memory(code: str, *arguments: str) -> float:
    """Peak resident memory (MB) that `code` adds to an interpreter with the package loaded."""
    script = (
        'import sys\n'
        'from grasp_replay import bag_reader, bag_repair, bag_writer\n'
        'from pathlib import Path\n'
        'peak = lambda: int(Path("/proc/self/status").read_text().split("VmHWM:")[1].split()[0])\n'
        'base = peak()\n'
        f'{code}\n'
        'print((peak() - base) / 1024)\n'
    )
    output = subprocess.run(
        [sys.executable, '-c', script, *arguments], check=True, capture_output=True, text=True
    ).stdout
    return float(output.split()[-1])


def memory(folder: Path, long: bool) -> Iterator[Row]:
    """Memory while reading and while recovering large bags."""
    for size in (100, 1000) if long else (50, 200):
        bag_path = write_clouds(folder / f'clouds_{size}', size)
        read = 'list(0 for _ in bag_reader.open_bag(sys.argv[1]).messages())'
        grown = peak_memory(read, str(bag_path))
        yield Row(f'memory, reading {size} MB', f'{grown:.0f} MB', '<= 64 MB', grown <= 64)
        file = bag_path / f'{bag_path.name}_0.mcap'
        os.truncate(file, file.stat().st_size - 1000)
        save = 'bag_repair.recover(bag_repair.examine([Path(sys.argv[1])]), Path(sys.argv[2]))'
        grown = peak_memory(save, str(file), str(folder / f'saved_{size}'))
        most = 3 * size + 64
        yield Row(
            f'memory, recovering {size} MB', f'{grown:.0f} MB', f'<= {most} MB', grown <= most
        )


def mutations(folder: Path, count: int) -> Iterator[Row]:
    """Random damage of a larger bag: what is recovered, and the slowest scan."""
    messages = [(f'/t{i % 4}', i * 20_000_000, f'message {i} ' * 9) for i in range(1000)]
    path = write_strings(folder / 'larger', messages, compression='zstd', chunk_every=50)
    source = original((path / 'larger_0.mcap').read_bytes())
    everything = set().union(*source.messages)
    generator = random.Random(7)
    crashes = missing = invented = 0
    slowest = 0.0
    for _ in range(count):
        content, start, end = damage(source.content, generator)
        begin = time.process_time()
        try:
            _, found = recovered(content)
        except Exception:
            crashes += 1
            continue
        slowest = max(slowest, time.process_time() - begin)
        missing += not untouched(source, start, end) <= found
        invented += not found <= everything
    what = f'{count} mutations of {len(source.content) // 1024} KB'
    yield Row(f'{what}: crashes', str(crashes), '0', crashes == 0)
    yield Row(f'{what}: with a whole chunk missing', str(missing), '0', missing == 0)
    yield Row(f'{what}: with invented messages', str(invented), '0', invented == 0)
    yield Row(f'{what}: slowest scan', f'{1e3 * slowest:.0f} ms', '<= 1 s', slowest <= 1.0)


def opened(folder: Path, count: int) -> Iterator[Row]:
    """Small damaged bags of every form, opened and read: only typed errors (asserted inside)."""
    began = time.perf_counter()
    shares = [count * (k + 1) // CORES - count * k // CORES for k in range(CORES)]
    places = [folder / f'opened_{k}' for k in range(CORES)]
    for place in places:
        place.mkdir()
    with ProcessPoolExecutor(CORES) as pool:
        done = list(pool.map(bag_mutations.run, shares, range(11, 11 + CORES), places))
    read, grown = sum(part[0] for part in done), max(part[1] for part in done)
    yield Row(
        f'{count} damaged small bags opened and read',
        f'0 untyped errors, {read} still read, peak +{grown / MEGABYTE:.1f} MB, '
        f'{time.perf_counter() - began:.0f} s',
    )


LISTENER = """
import sys, time, rclpy
from geometry_msgs.msg import WrenchStamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import HistoryPolicy, QoSProfile
rclpy.init()
node = rclpy.create_node('listener')
seen = []
take = lambda message: seen.append(message.wrench.force.x)
node.create_subscription(WrenchStamped, '/w', take, QoSProfile(history=HistoryPolicy.KEEP_ALL))
executor = SingleThreadedExecutor()
executor.add_node(node)
deadline = time.monotonic() + 120
while len(seen) < int(sys.argv[1]) and time.monotonic() < deadline:
    executor.spin_once(timeout_sec=0.1)
print(len(seen), seen == sorted(seen))
"""


def bare_lateness(count: int) -> float:
    """The 99 % lateness (s) of a loop that only sleeps, 1 000 times a second."""
    late = []
    begin = time.monotonic()
    for index in range(count):
        due = begin + 1e-3 * index
        time.sleep(max(0.0, due - time.monotonic()))
        late.append(time.monotonic() - due)
    return sorted(late)[round(0.99 * count)]


def replaying(folder: Path, seconds: int) -> Iterator[Row]:
    """Lateness and loss of `replay` at rate 1 with 1 000 messages per second."""
    count = 1000 * seconds
    bag_path = write_wrenches(folder / 'stream', count, 1000.0)
    listener = subprocess.Popen(
        [sys.executable, '-c', LISTENER, str(count)],
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        done = subprocess.run(
            [BIN / 'replay', bag_path, '--wait-for', '/w', '--json'],
            check=True,
            capture_output=True,
            text=True,
            timeout=120,
        )
        arrived, ordered = listener.communicate(timeout=120)[0].split()
    finally:
        listener.kill()
    report = json.loads(done.stdout)
    what = f'replay of {count} messages at 1000 /s'
    lost = count - int(arrived)
    median, p99 = 1e3 * report['lateness_median_s'], 1e3 * report['lateness_p99_s']
    yield Row(f'{what}: lost', str(lost), '0', lost == 0)
    yield Row(f'{what}: in order', ordered, 'True', ordered == 'True')
    yield Row(f'{what}: lateness median', f'{median:.2f} ms', '<= 0.5 ms', median <= 0.5)
    yield Row(f'{what}: lateness 99 %', f'{p99:.2f} ms', '<= 5 ms', p99 <= 5.0)
    yield Row('a bare loop of sleeps: lateness 99 %', f'{1e3 * bare_lateness(5000):.2f} ms')


def offline() -> Iterator[Row]:
    """Bag seconds per second: linear theory at every sample, koiter theory at every hold."""
    from grasp_replay.experiment import read_experiment
    from grasp_replay.holds import holds_of
    from grasp_replay.pipeline import PipelineOptions, run
    from grasp_replay.recording import read_recording
    from grasp_replay.sample_trace import trace_samples
    from grasp_replay.theories import theory_set

    def solve_all() -> float:
        recording = read_recording(BALL)
        held = [h.contacts for h in holds_of(recording, read_experiment(BALL)) if h.contacts]
        shell = theory_set('tennis_ball', held[0].point, float(held[0].radius.min()))
        trace_samples(recording, shell)
        state = None
        for contacts in held:
            patches = shell.patches(contacts)
            state = shell.solve('koiter', patches, contacts.push, state).state
        return recording.duration

    for attempt in ('with the first compilation', 'warm'):
        clock, cpu = time.perf_counter(), time.process_time()
        duration = solve_all()
        clock, cpu = time.perf_counter() - clock, time.process_time() - cpu
        yield Row(
            f'offline, linear every sample and koiter every hold, {attempt}',
            f'{duration / clock:.1f} x real time ({clock:.2f} s, processor {cpu:.2f} s)',
            '>= 10 x' if attempt == 'warm' else '',
            attempt != 'warm' or duration / clock >= 10.0,
        )
    cpu = time.process_time()
    run(BALL, PipelineOptions())
    cpu = time.process_time() - cpu
    yield Row(
        'offline, three theories, fit and comparison with every scan',
        f'{duration / cpu:.1f} x real time (processor {cpu:.2f} s)',
    )


def bare_gain() -> float:
    """What this machine gains from a second process: a loop that only counts, alone and twice."""
    count = (
        'import time; begin = time.perf_counter(); sum(range(3 * 10**8)); '
        'print(time.perf_counter() - begin)'
    )

    def seconds(processes: int) -> float:
        running = [
            subprocess.Popen([sys.executable, '-c', count], stdout=subprocess.PIPE, text=True)
            for _ in range(processes)
        ]
        return max(float(process.communicate()[0]) for process in running)

    return 2.0 * seconds(1) / seconds(2)


def throughput(folder: Path) -> Iterator[Row]:
    """Eight tasks on one and on two processes, the start of the workers left out."""
    from grasp_replay.campaign import Task, run_campaign

    tasks = [
        Task(BALL, (('young_modulus_pa', 12e6 + 1e5 * k),), None, 'object', False, True)
        for k in range(9)
    ]
    seconds = {}
    for processes in (1, 2):
        done: list[float] = []
        run_campaign(
            tasks[: 8 + processes - 1],
            folder / f'processes_{processes}',
            processes,
            show=lambda _share, _note, done=done: done.append(time.perf_counter()),  # type: ignore[misc]
        )
        # From the first answer on every worker is loaded and warm.
        seconds[processes] = (done[-1] - done[0]) / (len(done) - 1)
    gain = seconds[1] / seconds[2]
    yield Row(
        '8 tasks, throughput of two processes over one',
        f'{gain:.2f} ({seconds[1]:.1f} s a task alone)',
        '>= 1.7',
        gain >= 1.7,
    )
    yield Row('two bare loops, throughput of two processes over one', f'{bare_gain():.2f}')


def identical(folder: Path, runs: int) -> Iterator[Row]:
    """`results.json` of the ball and the can, on one, two and three processes in turn."""
    digests: dict[Path, list[str]] = {BALL: [], CAN: []}
    for number in range(runs):
        out = folder / f'run_{number}'
        subprocess.run(
            [BIN / 'grasp_report', *digests, '--out', out, '--no-page', '--no-samples']
            + ['--processes', str(1 + number % 3)],
            check=True,
            stdout=subprocess.DEVNULL,
        )
        for bag, found in digests.items():
            (file,) = out.glob(f'{bag.name}_*/results.json')
            found.append(hashlib.sha256(file.read_bytes()).hexdigest())
    for bag, found in digests.items():
        what = f'results.json of {bag.name}, {runs} runs on 1 to 3 processes'
        different = len(set(found))
        yield Row(what, f'{different} different', '1', different == 1)


def live(runs: int) -> Iterator[Row]:
    """The ball at rate 1 through replay, deformation and scan comparison as processes."""
    summaries = [demo.live(BALL, 1.0) for _ in range(runs)]
    what = f'{runs} live runs of {summaries[0]["contacts"]} samples at rate 1'
    lost = [summary['lost'] for summary in summaries]
    compared = sum(summary['compared'] for summary in summaries)
    scans = sum(summary['scans'] for summary in summaries)
    yield Row(f'{what}: lost', ' '.join(map(str, lost)), '0', not any(lost))
    yield Row(f'{what}: scans compared', str(compared), str(scans), compared == scans)


def checks(folder: Path, long: bool) -> dict[str, Callable[[], Iterator[Row]]]:
    """The figures by name."""
    return {
        'reading': lambda: reading(folder),
        'replaying': lambda: replaying(folder, 30 if long else 10),
        'mutations': lambda: mutations(folder, 100_000 if long else 2000),
        'opened': lambda: opened(folder, 1_000_000 if long else 2000),
        'memory': lambda: memory(folder, long),
        'offline': offline,
        'throughput': lambda: throughput(folder),
        'identical': lambda: identical(folder, 20 if long else 3),
        'live': lambda: live(10 if long else 1),
    }


def rows(names: Sequence[str] = (), long: bool = False) -> Iterator[Row]:
    """The figures; all of them without names."""
    with tempfile.TemporaryDirectory() as name:
        every = checks(Path(name), long)
        for wanted in names or every:
            yield from every[wanted]()


def main(arguments: Sequence[str] = ()) -> int:
    """Print the figures; returns 1 when one is short of its goal."""
    parser = argparse.ArgumentParser(description=__doc__)
    names = list(checks(Path(), False))
    parser.add_argument('names', nargs='*', help=f'which figures: {", ".join(names)}')
    parser.add_argument('--long', action='store_true', help='the full figures (minutes)')
    options = parser.parse_args(arguments)
    if unknown := sorted(set(options.names) - set(names)):
        parser.error(f'no figure {", ".join(unknown)}; there are {", ".join(names)}')
    return int(show(rows(options.names, options.long)) > 0)


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
