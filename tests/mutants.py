# SPDX-License-Identifier: Apache-2.0
"""Do the tests see? Small changes of the code, sampled by a seed, each run against its tests.

A mutant changes one thing on one line: a comparison, a sign, an operator, a constant, or
`and`/`or`. A constant is doubled; one below `TINY`, which guards a division or says what round-off
is, becomes one more, as mutmut and cosmic-ray do: twice a guard changes no result. A mutant is
killed when a test fails that passes without it, survives when all pass, and is undecided when one
hangs. The tests of a mutant are the quick ones of the files nearest to it: those that import its
module, then those that import what imports it; of each file those come first that name what it is
in, or what leads there in its file. A test that takes longer than `QUICK_S` is stopped, and is
asked again, with the time of `--slow`, about a mutant that all quick ones let pass; files further
away come last, those first that name most of that. Compiled kernels are reached through their
plain twins, so a mutant costs no compilation; everything else runs with the kernels as they are
compiled. Works in copies: the checkout is never changed. A run that is interrupted or asked to end
tells what it has found so far and leaves no process.
"""

from __future__ import annotations

import argparse
import ast
import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from queue import Queue
from typing import Any

from tests.patience import Patience
from tests.processes import descendants
from tests.quick_tests import LIMITS, Limits, Told, read_told

from shell_deform.compiled.cache import kernel_sources

ROOT = Path(__file__).parents[1]
SOURCES = Path('ros2_ws') / 'src'
GOAL = 0.9
# Pages, tables of parameters and pictures: nothing there decides a number.
LEFT_OUT = ('__init__', 'parameters', 'picture', '_node', 'page', 'setup')
# Files of tests that start processes: seconds to minutes each.
SLOW = ('_node', 'two_processes', 'fuzz', 'worker', 'conformance', 'campaign', 'recorded')
# So many files of tests, the nearest first, judge a mutant; so many more one that they let pass.
NEAREST, FURTHER = 6, 12
# A test that takes more processor time than this is slow; all of a mutant's together get so much,
# and whoever waits for longer than `HANGS_S` hangs [s].
QUICK_S, TOGETHER_S, HANGS_S = 1.0, 60.0, 180.0
COMPARISONS = {
    ast.Lt: ast.GtE, ast.LtE: ast.Gt, ast.Gt: ast.LtE, ast.GtE: ast.Lt,
    ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
}  # fmt: skip
COMMAND = (
    *(sys.executable, '-m', 'pytest', '-q', '-o', 'timeout=0'),
    *('-p', 'no:cacheprovider', '-p', 'tests.quick_tests'),
)
# So many of the tests that were stopped are asked whether they take long without the change, too.
FIRST_STOPPED = 2
# What pytest ends with where a conftest cannot be read.
CANNOT_BEGIN = 4
TINY = 1e-6
# What shows a number with so many digits, keeps so many results, or waits so long between looks.
COSMETIC = ('fixed', 'significant', 'lru_cache', 'sleep')
# Set where the whole run is to end.
CUT = threading.Event()
OPERATORS = {ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult}


@dataclass(frozen=True)
class Mutant:
    """One changed file: where, what it is in or leads there, what was changed, the new text."""

    path: Path
    line: int
    within: tuple[str, ...]
    change: str
    text: str


@dataclass(frozen=True)
class Verdict:
    """`killed`, `survived`, `undecided`, `no test`, `cut`; what killed, what was stopped first."""

    word: str
    test: str = ''
    stopped: tuple[str, ...] = ()


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
        node.value = 2 * node.value if abs(node.value) >= TINY else node.value + 1
        return 'constant'
    return None


def places(path: Path) -> list[int]:
    """Numbers of the nodes of a file's tree, as `ast.walk` meets them, that can be changed."""
    tree = ast.parse(path.read_text(encoding='utf-8'))
    alike = _alike(tree) | _compiled(tree)
    return [
        index
        for index, node in enumerate(ast.walk(tree))
        if id(node) not in alike and _changed(node) is not None
    ]


def mutant_at(path: Path, index: int) -> Mutant:
    """The file with the node of that number changed."""
    tree = ast.parse(path.read_text(encoding='utf-8'))
    node = list(ast.walk(tree))[index]
    change = _changed(node)
    assert change is not None
    line = getattr(node, 'lineno', 0)
    defined = [(name, node) for node in ast.walk(tree) for name in _names_of(node)]
    within = {name for name, node in defined if node.lineno <= line <= (node.end_lineno or line)}
    return Mutant(path, line, _leading(defined, within), change, ast.unparse(tree))


def _names_of(node: ast.AST) -> list[str]:
    """What a node defines: a function, a class, values."""
    if isinstance(node, ast.FunctionDef | ast.ClassDef):
        return [node.name]
    targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, 'target', None)]
    return [t.id for t in targets if isinstance(t, ast.Name) and t.id.isupper()]


def _leading(defined: list[tuple[str, Any]], to: set[str]) -> tuple[str, ...]:
    """These names of a file and those of it that use one of them, or one that does."""
    used = [
        (name, {getattr(n, 'id', getattr(n, 'attr', '')) for n in ast.walk(node)})
        for name, node in defined
        if not name.startswith('__')
    ]
    found = {name for name in to if not name.startswith('__')}
    while more := {name for name, names in used if names & found} - found:
        found |= more
    return tuple(sorted(found))


def _inside(parts: list[ast.AST | None]) -> set[int]:
    """Everything inside these parts of a tree, by identity."""
    return {id(node) for part in parts if part is not None for node in ast.walk(part)}


def _compiled(tree: ast.AST) -> set[int]:
    """What is there for a compiler alone."""
    named = [node for node in ast.walk(tree) if isinstance(node, ast.If)]
    return _inside([node for node in named if ast.unparse(node.test) == 'HAVE_NUMBA'])


def _alike(tree: ast.AST) -> set[int]:
    """Where a change changes nothing that a test of behaviour could be about.

    Annotations; the -1 of a reshape, as good as any -2; how many digits of a number and how much
    of a text a message shows; what `COSMETIC` names; and the goals of `verification`, which are
    what figures are held against: with twice the goal it is the check that is weaker.
    """
    parts: list[ast.AST | None] = []
    for node in ast.walk(tree):
        parts += [getattr(node, 'annotation', None), getattr(node, 'returns', None)]
        if isinstance(node, ast.Call):
            name = getattr(node.func, 'attr', getattr(node.func, 'id', ''))
            if name == 'reshape':
                parts += [a for a in node.args if isinstance(a, ast.UnaryOp)]
            if name in COSMETIC:
                given = (*node.args, *(keyword.value for keyword in node.keywords))
                parts += [one for one in given if isinstance(one, ast.Constant)]
        if isinstance(node, ast.FormattedValue):
            parts += [
                n.slice
                for n in ast.walk(node)
                if isinstance(n, ast.Subscript) and isinstance(n.slice, ast.Slice)
            ]
        if isinstance(node, ast.Assign) and any('GOAL' in ast.unparse(t) for t in node.targets):
            parts.append(node.value)
    return _inside(parts)


def _names(files: list[Path]) -> list[str]:
    """As pytest takes them, from the root."""
    return [str(file.relative_to(ROOT)) for file in files]


@cache
def kernels() -> frozenset[Path]:
    """Sources whose change compiles everything anew."""
    return frozenset(kernel_sources())


def modules() -> list[Path]:
    """The modules that can be reached without a compiler; of kernels those with a twin inside."""
    found = []
    for path in sorted((ROOT / SOURCES).glob('*/*/**/*.py')):
        inside = path.relative_to(ROOT / SOURCES).parts
        if inside[0] != inside[1] or any(part in path.stem for part in LEFT_OUT):
            continue
        if path not in kernels() or 'if HAVE_NUMBA:' in path.read_text(encoding='utf-8'):
            found.append(path)
    return found


def dotted(path: Path) -> str:
    """The name under which a file of a package is imported."""
    inside = path.is_relative_to(ROOT / SOURCES)
    parts = path.relative_to(ROOT / SOURCES if inside else ROOT).with_suffix('').parts[inside:]
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
    """Who imports each module: files of the packages and their tests, and those of the root."""
    found: dict[str, set[Path]] = {}
    for folder in ('tests', 'docs', 'bags'):
        for path in (ROOT / folder).glob('*.py'):
            for one in imported(path, ''):
                found.setdefault(one, set()).add(path)
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

    def rank(test: Path) -> tuple[bool, bool, int, int]:
        elsewhere = test.relative_to(ROOT).parts[:3] != path.relative_to(ROOT).parts[:3]
        known = len(defined & words(test))
        return elsewhere, path.stem not in test.stem, -known, test.stat().st_size

    seen: set[Path] = {path}
    tests: list[Path] = []
    front = [path]
    while front:
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
    return tests


def further(mutant: Mutant, tests: list[Path]) -> list[str]:
    """Files of tests behind the nearest: first those that name what a mutant is in."""
    return sorted(_names(tests[NEAREST:]), key=partial(_far, mutant))[:FURTHER]


def _far(mutant: Mutant, test: str) -> int:
    """Less, the more of what leads to a mutant is named in the file of a test."""
    return -len(set(mutant.within) & words(ROOT / test.partition('::')[0]))


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

    def judge(self, mutant: Mutant, slow_s: float) -> Verdict:
        """Run the tests of a mutant; the slow ones for so long, if the quick ones pass [s]."""
        chosen = tests_of(mutant.path)
        if CUT.is_set():
            return Verdict('cut')
        if not chosen:
            return Verdict('no test')
        changed = self.folder / mutant.path.relative_to(ROOT)
        before = changed.read_text(encoding='utf-8')
        changed.write_text(mutant.text, encoding='utf-8')
        try:
            return self._run(mutant, chosen, slow_s)
        finally:
            changed.write_text(before, encoding='utf-8')

    def _run(self, mutant: Mutant, chosen: list[Path], slow_s: float) -> Verdict:
        told = self.tests(_names(chosen[:NEAREST]), mutant)
        stopped = told.slow[:FIRST_STOPPED]
        if told.slow and not told.failed and slow_s:
            told = self.tests(sorted(told.slow, key=partial(_far, mutant)), mutant, slow_s)
        others = further(mutant, chosen)
        if others and not told.failed and not told.hangs and slow_s:
            told = self.tests(others, mutant)
        if CUT.is_set():
            return Verdict('cut')
        if told.failed:
            return Verdict('killed', told.failed)
        return Verdict('undecided' if told.hangs else 'survived', stopped=stopped)

    def tests(self, names: list[str], mutant: Mutant | None, slow_s: float = 0.0) -> Told:
        """Run tests till one fails: the quick ones, or all of them for a while."""
        packages = [str(p) for p in (self.folder / SOURCES).iterdir() if p.is_dir()]
        together = (slow_s or TOGETHER_S) if mutant is not None else float('inf')
        limits = Limits(
            slow_s or QUICK_S, together,
            mutant.within if mutant is not None else (), str(self.folder / 'told.json'),
        )  # fmt: skip
        environment = os.environ | {
            'PYTHONPATH': os.pathsep.join([*packages, str(self.folder)]),
            'PYTHONDONTWRITEBYTECODE': '1',
            LIMITS: limits.text,
        }
        if mutant is not None and mutant.path in kernels():
            environment['NUMBA_DISABLE_JIT'] = '1'
        Path(limits.told).unlink(missing_ok=True)
        process = subprocess.Popen(
            [*COMMAND, *(() if mutant is None else ('-x',)), *names],
            cwd=self.folder, env=environment, start_new_session=True,
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        hangs = not ended(process, max(HANGS_S, 2.0 * slow_s) if mutant is not None else 600.0)
        told = read_told(Path(limits.told))
        if process.returncode == CANNOT_BEGIN:
            told = replace(told, failed=names[0])
        return replace(told, hangs=hangs)


def ended(process: subprocess.Popen[bytes], patience_s: float) -> bool:
    """Whether tests end by themselves in that time; if not they end with all they started [s]."""
    patience = Patience(patience_s)
    while process.poll() is None:
        if patience.over or CUT.is_set():
            os.killpg(process.pid, signal.SIGSTOP)
            below = descendants(process.pid)
            os.killpg(process.pid, signal.SIGKILL)
            for pid in below:
                with suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)
            process.wait()
            return False
        time.sleep(0.05)
    return True


def judged(sample: list[Mutant], slow_s: float, processes: int) -> list[Verdict]:
    """The verdicts, in order; each is told on stderr as it comes."""
    with tempfile.TemporaryDirectory() as folder:
        free: Queue[Copy] = Queue()
        for number in range(processes):
            free.put(Copy(Path(folder) / str(number)))

        def judge(mutant: Mutant) -> Verdict:
            copy = free.get()
            try:
                verdict = copy.judge(mutant, slow_s)
            finally:
                free.put(copy)
            where = f'{mutant.path.relative_to(ROOT / SOURCES)}:{mutant.line}'
            if verdict.word != 'cut':
                found = f'{verdict.word:9}  {where}  {mutant.change}  {verdict.test}'
                print(found, file=sys.stderr, flush=True)
            return verdict

        with ThreadPoolExecutor(processes) as pool:
            verdicts = list(pool.map(judge, sample))
        told = Told() if CUT.is_set() else _unchanged(free.get(), verdicts)
    # What fails without the change, too, says nothing of it; what is stopped with it alone hangs.
    return [
        replace(v, word='undecided')
        if v.test in told.all_failed or not (CUT.is_set() or set(v.stopped) <= set(told.slow))
        else v
        for v in verdicts
    ]


def _unchanged(copy: Copy, verdicts: list[Verdict]) -> Told:
    """What the tests that killed or were stopped do without any change."""
    tests = sorted({name for v in verdicts for name in (v.test, *v.stopped) if name})
    return copy.tests(tests, None) if tests else Told()


def main() -> int:
    """Sample, judge, print; returns 1 when fewer than the goal of the decided ones are killed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--count', type=int, default=100, help='mutants')
    parser.add_argument('--seed', type=int, default=1, help='of the sample')
    parser.add_argument('--skip', type=int, default=0, help='so many of the sample, judged before')
    parser.add_argument(
        '--slow',
        type=float,
        default=20.0,
        help='for the slow tests of one that survives; 0: none (s)',
    )
    parser.add_argument('--processes', type=int, default=2, help='mutants judged at a time')
    parser.add_argument('--match', default='', help='only modules whose path holds this')
    parser.add_argument('--json', action='store_true', help='one JSON document on stdout')
    options = parser.parse_args()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: CUT.set())
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
    verdicts = judged(sample, options.slow, options.processes)
    score = Counter(verdict.word for verdict in verdicts if verdict.word != 'cut')
    decided = score['killed'] + score['survived']
    share = score['killed'] / max(decided, 1)
    rows = [
        {
            'file': str(m.path.relative_to(ROOT)),
            'line': m.line,
            'change': m.change,
            'verdict': v.word,
            'test': v.test,
        }  # fmt: skip
        for m, v in zip(sample, verdicts, strict=True)
    ]
    if options.json:
        print(json.dumps({'seed': options.seed, 'killed_of_decided': share, 'mutants': rows}))
    else:
        for row in rows:
            if row['verdict'] not in ('killed', 'cut'):
                print(f'{row["verdict"]:9}  {row["file"]}:{row["line"]}  {row["change"]}')
        print(
            f'{score["killed"]} of {decided} decided mutants killed ({100 * share:.0f} %); {score}'
        )
    return 0 if share >= GOAL else 1


if __name__ == '__main__':
    sys.exit(main())
