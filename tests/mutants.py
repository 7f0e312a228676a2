# SPDX-License-Identifier: Apache-2.0
"""Do the tests see? Small changes of the code, sampled by a seed, each run against its tests.

A mutant changes one thing on one line: a comparison, a sign, an operator, a constant, or
`and`/`or`. It is killed when a test fails, survives when all pass, and is undecided when time runs
out. The tests of a mutant are the quick files nearest to it: those that import its module, then
those that import what imports it; first of all those that name what the module defines. Compiled
kernels are reached through their plain twins, so a mutant costs no compilation; everything else
runs with the kernels as they are compiled. Works in copies: the checkout is never changed.
"""

from __future__ import annotations

import argparse
import ast
import json
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from queue import Queue

from tests.patience import Patience

from shell_deform.compiled.cache import kernel_sources

ROOT = Path(__file__).parents[1]
SOURCES = Path('ros2_ws') / 'src'
GOAL = 0.9
# Pages, tables of parameters and pictures: nothing there decides a number.
LEFT_OUT = ('__init__', 'parameters', 'picture', '_node', 'page', 'setup')
# Files of tests that start processes: seconds to minutes each.
SLOW = (
    *('_node', 'two_processes', 'fuzz', 'worker', 'faults', 'command', 'emulator', 'bags', 'job'),
    *('conformance', 'campaign', 'recorded'),
)
# So many files of tests, the nearest first, judge a mutant.
NEAREST = 6
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


def places(path: Path) -> list[int]:
    """Numbers of the nodes of a file's tree, as `ast.walk` meets them, that can be changed."""
    tree = ast.parse(path.read_text(encoding='utf-8'))
    alike = _alike(tree)
    return [
        index
        for index, node in enumerate(ast.walk(tree))
        if (getattr(node, 'lineno', 0), getattr(node, 'col_offset', 0)) not in alike
        and _changed(node) is not None
    ]


def mutant_at(path: Path, index: int) -> Mutant:
    """The file with the node of that number changed."""
    tree = ast.parse(path.read_text(encoding='utf-8'))
    node = list(ast.walk(tree))[index]
    change = _changed(node)
    assert change is not None
    return Mutant(path, getattr(node, 'lineno', 0), change, ast.unparse(tree))


def _alike(tree: ast.AST) -> set[tuple[int, int]]:
    """Where a change changes nothing: annotations, and the -1 of a reshape, as good as any -2."""
    found: set[tuple[int, int]] = set()
    for node in ast.walk(tree):
        parts = [getattr(node, 'annotation', None), getattr(node, 'returns', None)]
        if isinstance(node, ast.Call) and getattr(node.func, 'attr', '') == 'reshape':
            parts += [a for a in node.args if isinstance(a, ast.UnaryOp)]
        for part in parts:
            if part is not None:
                found |= {(n.lineno, n.col_offset) for n in ast.walk(part) if hasattr(n, 'lineno')}
    return found


def modules() -> list[Path]:
    """The modules that can be reached without a compiler."""
    kernels = set(kernel_sources())
    found = []
    for path in sorted((ROOT / SOURCES).glob('*/*/**/*.py')):
        inside = path.relative_to(ROOT / SOURCES).parts
        if inside[0] != inside[1] or any(part in path.stem for part in LEFT_OUT):
            continue
        if path not in kernels:
            found.append(path)
    return found


def dotted(path: Path) -> str:
    """The name under which a file of a package is imported."""
    parts = path.relative_to(ROOT / SOURCES).with_suffix('').parts[1:]
    return '.'.join(parts[:-1] if parts[-1] == '__init__' else parts)


def imported(path: Path, own: str) -> set[str]:
    """Names of modules, and of what may be one, that a file imports; `own`: its package."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            above = own.split('.')[: len(own.split('.')) - node.level + 1] if node.level else []
            base = '.'.join([*above, *([node.module] if node.module else [])])
            names |= {base} | {f'{base}.{alias.name}' for alias in node.names}
    return names


@cache
def importers() -> dict[str, set[Path]]:
    """Who imports each module: files of the packages and their tests."""
    found: dict[str, set[Path]] = {}
    for path in (ROOT / SOURCES).glob('*/*/**/*.py'):
        inside = path.relative_to(ROOT / SOURCES).parts
        if inside[0] == inside[1]:
            name = dotted(path)
            own = name if path.stem == '__init__' else name.rpartition('.')[0]
        elif inside[1] == 'test':
            own = ''
        else:
            continue
        for one in imported(path, own):
            found.setdefault(one, set()).add(path)
    for helper in (ROOT / SOURCES).glob('*/test/*.py'):
        for test in found.get(helper.stem, set()):
            found.setdefault(f'test {helper.stem}', set()).add(test)
    return found


@cache
def words(path: Path) -> frozenset[str]:
    """The words of a file."""
    return frozenset(re.findall(r'\w+', path.read_text(encoding='utf-8')))


def tests_of(path: Path) -> list[Path]:
    """Quick files of tests that reach a module: the nearest first, then those that name most."""
    tree = ast.parse(path.read_text(encoding='utf-8'))
    defined = {
        node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef | ast.ClassDef)
    }

    def rank(test: Path) -> tuple[int, int]:
        return -len(defined & words(test)), test.stat().st_size

    seen, tests, front = {path}, [], [path]
    while front and len(tests) < NEAREST:
        reached: set[Path] = set()
        for one in front:
            helper = one.parent.name == 'test'
            reached |= importers().get(f'test {one.stem}' if helper else dotted(one), set())
        reached -= seen
        seen |= reached
        near = [one for one in reached if one.stem.startswith('test_')]
        near = [one for one in near if not any(word in one.stem for word in SLOW)]
        tests += sorted(near, key=rank)
        front = sorted(one for one in reached if not one.stem.startswith('test_'))
    return tests[:NEAREST]


class Copy:
    """A copy of the sources, with their compiled kernels, in which mutants are judged in turn."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        ignored = shutil.ignore_patterns('*.pyc')
        shutil.copytree(ROOT / SOURCES, folder / SOURCES, ignore=ignored)
        for name in ('conftest.py', 'pyproject.toml'):
            shutil.copy(ROOT / name, folder / name)
        for name in ('bags', 'docs', 'tests'):
            (folder / name).symlink_to(ROOT / name)

    def judge(self, mutant: Mutant, seconds: float) -> str:
        """Run the tests of a mutant: `killed`, `survived`, `undecided` or `no test`."""
        chosen = tests_of(mutant.path)
        if not chosen:
            return 'no test'
        changed = self.folder / mutant.path.relative_to(ROOT)
        before = changed.read_text(encoding='utf-8')
        changed.write_text(mutant.text, encoding='utf-8')
        try:
            return self._run(chosen, seconds)
        finally:
            changed.write_text(before, encoding='utf-8')

    def _run(self, chosen: list[Path], seconds: float) -> str:
        packages = [str(p) for p in (self.folder / SOURCES).iterdir() if p.is_dir()]
        environment = os.environ | {
            'PYTHONPATH': os.pathsep.join(packages),
            'PYTHONDONTWRITEBYTECODE': '1',
        }
        command = [sys.executable, '-m', 'pytest', '-x', '-q', '-p', 'no:cacheprovider']
        verdict = 'survived'
        # One package at a time: each has a conftest of its own.
        for package in dict.fromkeys(test.parent for test in chosen):
            files = [t.relative_to(ROOT) for t in chosen if t.parent == package]
            process = subprocess.Popen(
                [*command, *map(str, files)],
                cwd=self.folder, env=environment, start_new_session=True,
                stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
            )  # fmt: skip
            patience = Patience(seconds)
            while process.poll() is None and not patience.over:
                time.sleep(0.05)
            if process.poll() is None:
                os.killpg(process.pid, 9)
                process.wait()
            # 1: tests failed; 2 and 4: a file of tests, a conftest could not be read. 0 and 5: all
            # passed, none was selected.
            if process.returncode in (1, 2, 4):
                return 'killed'
            if process.returncode not in (0, 5):
                verdict = 'undecided'
        return verdict


def judged(sample: list[Mutant], seconds: float, processes: int) -> list[str]:
    """The verdicts, in order; each is told on stderr as it comes."""
    with tempfile.TemporaryDirectory() as folder:
        free: Queue[Copy] = Queue()
        for number in range(processes):
            free.put(Copy(Path(folder) / str(number)))

        def judge(mutant: Mutant) -> str:
            copy = free.get()
            try:
                verdict = copy.judge(mutant, seconds)
            finally:
                free.put(copy)
            where = f'{mutant.path.relative_to(ROOT / SOURCES)}:{mutant.line}'
            print(f'{verdict:9}  {where}  {mutant.change}', file=sys.stderr, flush=True)
            return verdict

        with ThreadPoolExecutor(processes) as pool:
            return list(pool.map(judge, sample))


def main() -> int:
    """Sample, judge, print; returns 1 when fewer than the goal of the decided ones are killed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--count', type=int, default=100, help='mutants')
    parser.add_argument('--seed', type=int, default=1, help='of the sample')
    parser.add_argument('--skip', type=int, default=0, help='so many of the sample, judged before')
    parser.add_argument('--seconds', type=float, default=180.0, help='longest run of one (s)')
    parser.add_argument('--processes', type=int, default=2, help='mutants judged at a time')
    parser.add_argument('--match', default='', help='only modules whose path holds this')
    parser.add_argument('--json', action='store_true', help='one JSON document on stdout')
    options = parser.parse_args()
    choice = random.Random(options.seed)
    files = [path for path in modules() if options.match in str(path)]
    weights = [len(path.read_text(encoding='utf-8').splitlines()) for path in files]
    drawn: list[tuple[Path, int]] = []
    while len(drawn) < options.count:
        path = choice.choices(files, weights)[0]
        found = places(path)
        if found:
            drawn.append((path, choice.choice(found)))
    sample = [mutant_at(path, index) for path, index in drawn[options.skip :]]
    verdicts = judged(sample, options.seconds, options.processes)
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
