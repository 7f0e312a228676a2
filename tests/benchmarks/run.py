"""`make bench`: every benchmark table, one after the other; `run.py solver live` only those.

Each benchmark is a module of this folder with a `main()` that prints rows of what, value and goal;
it runs as a process of its own, so that none heats the caches of another.
"""

import subprocess
import sys
from pathlib import Path

FOLDER = Path(__file__).resolve().parent


def names() -> list[str]:
    """The benchmarks there are."""
    return sorted(path.stem for path in FOLDER.glob('*.py') if path.stem != Path(__file__).stem)


def main() -> int:
    """Run the wanted benchmarks; 1 if one of them failed."""
    wanted = sys.argv[1:] or names()
    unknown = sorted(set(wanted) - set(names()))
    if unknown:
        print(f'no benchmark {", ".join(unknown)}; there are {", ".join(names())}')
        return 2
    failed = []
    for name in wanted:
        print(f'== {name}', flush=True)
        if subprocess.run([sys.executable, FOLDER / f'{name}.py'], check=False).returncode:
            failed.append(name)
    if failed:
        print(f'failed: {", ".join(failed)}')
    return int(bool(failed))


if __name__ == '__main__':
    sys.exit(main())
