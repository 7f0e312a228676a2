"""The example of the README runs as it is printed."""

import re
from pathlib import Path

README = Path(__file__).parents[1] / 'README.md'


def test_ten_lines_solve_a_squeezed_ball(capsys):
    code = re.search(r'```python\n(.*?)```', README.read_text(), re.DOTALL)
    assert code is not None
    names: dict[str, object] = {}
    exec(compile(code.group(1), str(README), 'exec'), names)
    lines = capsys.readouterr().out.strip().splitlines()
    assert len(lines) == 6
    forces = [float(line.split()[2]) for line in lines]
    assert forces[0] == 0.0 and all(a < b for a, b in zip(forces, forces[1:], strict=False))
    assert 18.0 < forces[-1] < 24.0
    statements = [line for line in code.group(1).splitlines() if line and 'import' not in line]
    assert len(statements) <= 10
