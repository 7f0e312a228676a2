# SPDX-License-Identifier: Apache-2.0
"""Do the tests see? Small changes of the code, sampled by a seed, each run against its tests.

A mutant changes one thing on one line: a comparison, a sign, an operator, a constant, `and`/`or`,
or drops a statement. It is killed when a test fails, survives when all pass, and is undecided when
time runs out. Compiled kernels are reached through their plain twins (NUMBA_DISABLE_JIT=1), so a
mutant costs seconds and no compilation. Works in a copy: the checkout is never changed.
"""

from __future__ import annotations

import argparse
import ast
import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
SOURCES = Path('ros2_ws') / 'src'
GOAL = 0.9
# Pages, tables of parameters and pictures: nothing there decides a number.
LEFT_OUT = ('__init__', 'parameters', 'picture', '_node', 'page', 'setup')
# Files of tests that start processes: seconds to minutes each.
SLOW = ('_node', 'two_processes', 'fuzz', 'worker', 'faults', 'command', 'emulator', 'bags', 'job')
COMPARISONS = {
    ast.Lt: ast.GtE, ast.LtE: ast.Gt, ast.Gt: ast.LtE, ast.GtE: ast.Lt,
    ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
}  # fmt: skip
OPERATORS = {ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult}


@dataclass(frozen=True)
class Mutant:
    """One changed file: where, what was there and the whole new text."""

    path: Path
    line: int
    change: str
    text: str


def _changed(node: ast.AST) -> str | None:
    """Change a node in place; returns what was done, None where there is nothing to change."""
    if isinstance(node, ast.Compare) and type(node.ops[0]) in COMPARISONS:
        node.ops[0] = COMPARISONS[type(node.ops[0])]()
        return 'comparison'
    if isinstance(node, ast.BinOp | ast.AugAssign) and type(node.op) in OPERATORS:
        node.op = OPERATORS[type(node.op)]()
        return 'operator'
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        node.op = ast.UAdd()
        return 'sign'
    if isinstance(node, ast.BoolOp):
        node.op = ast.Or() if isinstance(node.op, ast.And) else ast.And()
        return 'and / or'
    if isinstance(node, ast.Constant) and type(node.value) in (int, float):
        node.value = 2 * node.value if node.value else node.value + 1
        return 'constant'
    return None


def mutants(path: Path) -> Iterator[Mutant]:
    """Every mutant of one file, a few to a line."""
    source = path.read_text(encoding='utf-8')
    count = sum(1 for _ in ast.walk(ast.parse(source)))
    annotated = _annotations(ast.parse(source))
    for index in range(count):
        tree = ast.parse(source)
        node = list(ast.walk(tree))[index]
        line = getattr(node, 'lineno', 0)
        if (line, getattr(node, 'col_offset', 0)) in annotated:
            continue
        change = _changed(node)
        if change is not None:
            yield Mutant(path, line, change, ast.unparse(tree))


def _annotations(tree: ast.AST) -> set[tuple[int, int]]:
    found: set[tuple[int, int]] = set()
    for node in ast.walk(tree):
        for part in (getattr(node, 'annotation', None), getattr(node, 'returns', None)):
            if part is not None:
                found |= {(n.lineno, n.col_offset) for n in ast.walk(part) if hasattr(n, 'lineno')}
    return found


def modules() -> list[Path]:
    """The modules that can be reached without a compiler."""
    found = []
    for path in sorted((ROOT / SOURCES).glob('*/*/**/*.py')):
        inside = path.relative_to(ROOT / SOURCES).parts
        if inside[0] != inside[1] or any(part in path.stem for part in LEFT_OUT):
            continue
        if 'from numba' not in path.read_text(encoding='utf-8'):
            found.append(path)
    return found


def tests_of(path: Path) -> list[Path]:
    """Quick test files that name the module, or a module that imports it."""
    package = path.relative_to(ROOT / SOURCES).parts[0]
    dotted = '.'.join(path.relative_to(ROOT / SOURCES / package).with_suffix('').parts)
    importers = {dotted}
    for other in (ROOT / SOURCES / package / package).rglob('*.py'):
        if f'from {dotted} import' in other.read_text(encoding='utf-8'):
            parts = other.relative_to(ROOT / SOURCES / package).with_suffix('').parts
            importers.add('.'.join(parts))
    direct, through = [], []
    for test in sorted((ROOT / SOURCES / package / 'test').glob('test_*.py')):
        if any(word in test.stem for word in SLOW):
            continue
        text = test.read_text(encoding='utf-8')
        if f'{dotted} import' in text:
            direct.append(test)
        elif any(f'{name} import' in text for name in importers):
            through.append(test)
    return direct + through


def judge(mutant: Mutant, seconds: float) -> str:
    """Run the mutant's tests in a copy of the sources; `killed`, `survived` or `undecided`."""
    chosen = tests_of(mutant.path)
    if not chosen:
        return 'no test'
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder)
        shutil.copytree(ROOT / SOURCES, copy / SOURCES, ignore=shutil.ignore_patterns('*.pyc'))
        for name in ('conftest.py', 'pyproject.toml'):
            shutil.copy(ROOT / name, copy / name)
        for name in ('bags', 'docs', 'tests'):
            (copy / name).symlink_to(ROOT / name)
        (copy / mutant.path.relative_to(ROOT)).write_text(mutant.text, encoding='utf-8')
        packages = [str(p) for p in (copy / SOURCES).iterdir() if p.is_dir()]
        environment = os.environ | {
            'PYTHONPATH': os.pathsep.join(packages),
            'NUMBA_DISABLE_JIT': '1',
            'PYTHONDONTWRITEBYTECODE': '1',
        }
        command = [sys.executable, '-m', 'pytest', '-x', '-q', '-p', 'no:cacheprovider']
        files = [str(copy / test.relative_to(ROOT)) for test in chosen]
        process = subprocess.Popen(
            [*command, *files],
            cwd=copy, env=environment, start_new_session=True,
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        try:
            # 1: tests failed. Anything else is no verdict of a test.
            return {0: 'survived', 1: 'killed'}.get(process.wait(seconds), 'undecided')
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, 9)
            process.wait()
            return 'undecided'


def main() -> int:
    """Sample, judge, print; returns 1 when fewer than the goal of the decided ones are killed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--count', type=int, default=100, help='mutants')
    parser.add_argument('--seed', type=int, default=1, help='of the sample')
    parser.add_argument('--seconds', type=float, default=180.0, help='longest run of one (s)')
    parser.add_argument('--match', default='', help='only modules whose path holds this')
    parser.add_argument('--json', action='store_true', help='one JSON document on stdout')
    options = parser.parse_args()
    choice = random.Random(options.seed)
    files = [path for path in modules() if options.match in str(path)]
    weights = [len(path.read_text(encoding='utf-8').splitlines()) for path in files]
    sample: list[Mutant] = []
    while len(sample) < options.count:
        found = list(mutants(choice.choices(files, weights)[0]))
        if found:
            sample.append(choice.choice(found))
    with ThreadPoolExecutor(2) as pool:
        verdicts = list(pool.map(lambda mutant: judge(mutant, options.seconds), sample))
    score = Counter(verdicts)
    decided = score['killed'] + score['survived']
    share = score['killed'] / max(decided, 1)
    rows = [
        {'file': str(m.path.relative_to(ROOT)), 'line': m.line, 'change': m.change, 'verdict': v}
        for m, v in zip(sample, verdicts, strict=True)
    ]
    if options.json:
        print(json.dumps({'seed': options.seed, 'killed_of_decided': share, 'mutants': rows}))
    else:
        for row in rows:
            if row['verdict'] != 'killed':
                print(f'{row["verdict"]:9}  {row["file"]}:{row["line"]}  {row["change"]}')
        print(
            f'{score["killed"]} of {decided} decided mutants killed ({100 * share:.0f} %); {score}'
        )
    return 0 if share >= GOAL else 1


if __name__ == '__main__':
    sys.exit(main())
