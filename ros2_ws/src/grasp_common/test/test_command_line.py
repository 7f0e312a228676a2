# SPDX-License-Identifier: Apache-2.0
"""What every console script does before its work."""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from grasp_common.command_line import command, parse, version_of


def script(tmp_path: Path, source: str) -> None:
    (tmp_path / 'small_program.py').write_text(source)


def run(tmp_path: Path, *arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    # What is started behind a shell's & ignores interrupts, and so would this process.
    code = (
        'import signal, sys\n'
        'signal.signal(signal.SIGINT, signal.default_int_handler)\n'
        'from grasp_common.command_line import command\n'
        "sys.exit(command('small', 'small_program')())"
    )
    return subprocess.run(
        [sys.executable, '-c', code, *arguments],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, 'PYTHONPATH': str(tmp_path), **environment},
    )


def test_the_version_is_told_without_importing_anything(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert command('record', 'grasp_common.no_such_module')(['--version']) == 0
    assert capsys.readouterr().out == f'record {version_of("grasp_common")}\n'


@pytest.mark.parametrize(
    ('module', 'sentence'),
    [
        ('fast_simplification_', 'fast_simplification_ is missing: pip install'),
        ('nothing_msgs.msg', 'nothing_msgs is missing: source a ROS 2 Jazzy'),
    ],
)
@pytest.mark.parametrize('where', ['{}', 'def main(arguments):\n    {}'])
def test_a_missing_package_is_one_sentence(
    tmp_path: Path, module: str, sentence: str, where: str
) -> None:
    script(tmp_path, where.format(f'import {module}'))
    done = run(tmp_path)
    assert (done.returncode, done.stdout) == (1, '')
    assert done.stderr.startswith(f'small: {sentence}') and done.stderr.count('\n') == 1


def test_an_interrupt_while_it_imports_ends_it_in_silence(tmp_path: Path) -> None:
    script(tmp_path, 'import os, signal\nos.kill(os.getpid(), signal.SIGINT)\n')
    done = run(tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (-signal.SIGINT, '', '')


def test_a_reader_that_has_seen_enough_is_no_error(tmp_path: Path) -> None:
    script(
        tmp_path, "def main(arguments):\n    for _ in range(100_000):\n        print('x' * 50)\n"
    )
    code = (
        'import sys; from grasp_common.command_line import command\n'
        "sys.exit(command('small', 'small_program')())"
    )
    words = f'{sys.executable} -c "$CODE" | head -1'
    done = subprocess.run(
        ['sh', '-c', words],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, 'PYTHONPATH': str(tmp_path), 'CODE': code},
    )
    assert (done.stdout, done.stderr) == ('x' * 50 + '\n', '')


def test_the_program_itself_may_catch_an_interrupt(tmp_path: Path) -> None:
    script(
        tmp_path,
        'import os, signal\n'
        'def main(arguments):\n'
        '    try:\n        os.kill(os.getpid(), signal.SIGINT)\n'
        '    except KeyboardInterrupt:\n        return 7\n',
    )
    assert run(tmp_path).returncode == 7


def test_an_interrupt_of_a_program_that_does_not_is_one_sentence(tmp_path: Path) -> None:
    script(
        tmp_path,
        'import os, signal\ndef main(arguments):\n    os.kill(os.getpid(), signal.SIGINT)\n',
    )
    done = run(tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (1, '', 'small: interrupted\n')


def test_options_complete_in_a_shell(tmp_path: Path) -> None:
    script(
        tmp_path,
        'import argparse\nfrom grasp_common.command_line import parse\n'
        'def main(arguments):\n'
        "    parser = argparse.ArgumentParser(prog='small')\n"
        "    parser.add_argument('--thickness')\n"
        "    parse('grasp_common', parser, arguments)\n",
    )
    told = tmp_path / 'told'
    asked = {'COMP_LINE': 'small --th', 'COMP_POINT': '10', '_ARGCOMPLETE': '1'}
    run(tmp_path, **asked, _ARGCOMPLETE_STDOUT_FILENAME=str(told))
    assert told.read_text().strip() == '--thickness'


def test_every_usage_names_the_version(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        parse('grasp_common', argparse.ArgumentParser(prog='small'), ['--help'])
    assert caught.value.code == 0 and '--version' in capsys.readouterr().out


def test_a_value_that_begins_with_a_minus_belongs_to_its_option() -> None:
    parser = argparse.ArgumentParser(prog='x')
    parser.add_argument('--contact', action='append')
    parser.add_argument('--json', action='store_true')
    options = parse(
        'grasp_common', parser, ['--contact', '-0.03,0,0', '--contact', '-.5', '--json']
    )
    assert options.contact == ['-0.03,0,0', '-.5']
    assert options.json
