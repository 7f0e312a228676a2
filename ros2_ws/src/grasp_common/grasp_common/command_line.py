# SPDX-License-Identifier: Apache-2.0
"""What all commands and nodes do alike before and around their work.

A console script is a `command`: it answers `--version` at once, imports its module only then, says
in one sentence which package is missing, and can be interrupted while it imports.
"""

from __future__ import annotations

import argparse
import os
import re
import signal
import sys
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module

from grasp_common.terminal import complain

Main = Callable[..., int]

DISTRIBUTIONS = {
    'PIL': 'pillow',
    'can': 'python-can',
    'fast_simplification': 'fast-simplification',
    'serial': 'pyserial',
    'yaml': 'pyyaml',
}
"""Packages whose name in a registry is not that of their module."""

ROS = ('rclpy', 'rosgraph_msgs', 'rpyutils', 'rcl_interfaces', 'builtin_interfaces', 'std_srvs')


def version_of(package: str) -> str:
    """The version of an installed package, from its metadata."""
    # Reading metadata takes longer than a usage text may.
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version(package)
    except PackageNotFoundError:
        return 'of a source tree that is not installed'


def missing(error: ModuleNotFoundError) -> str:
    """A sentence on a module that is not there, and the way to it."""
    module = (error.name or str(error)).partition('.')[0]
    if module in ROS or module.endswith('_msgs'):
        return f'{module} is missing: source a ROS 2 Jazzy, or use the environment of `make setup`'
    return f'{module} is missing: pip install {DISTRIBUTIONS.get(module, module)}'


def command(name: str, module: str, usage: str = '') -> Main:
    """The function that a console script runs: `main` of the module, found when it is called.

    `usage`: a module whose `usage()` is the usage text; neither ROS nor a solver is loaded for it.
    """
    package = module.partition('.')[0]

    def main(arguments: Sequence[str] | None = None) -> int:
        given = list(sys.argv[1:] if arguments is None else arguments)
        if '--version' in given:
            print(f'{name} {version_of(package)}')
            return 0
        # Nothing is open while modules are imported: a signal may end it as it stands.
        before = signal.signal(signal.SIGINT, signal.SIG_DFL)
        try:
            if usage and {'-h', '--help'} & set(given):
                print(import_module(usage).usage())
                return 0
            run: Main = import_module(module).main
            signal.signal(signal.SIGINT, before)
            return run(given)
        except ModuleNotFoundError as error:
            complain(name, missing(error))
            return 1
        except KeyboardInterrupt:
            complain(name, 'interrupted')
            return 1
        except BrokenPipeError:
            # Whoever read the output (`| head`) has seen enough: nothing can be flushed there.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return 128 + signal.SIGPIPE

    return main


class _Version(argparse.Action):
    """Prints program and version; `const` is the package."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        print(f'{parser.prog} {version_of(str(self.const))}')
        parser.exit()


def usage_of(package: str, parser: argparse.ArgumentParser) -> str:
    """The usage text of a command, with what all commands have."""
    return _with_version(package, parser).format_help().rstrip()


def _with_version(package: str, parser: argparse.ArgumentParser) -> argparse.ArgumentParser:
    parser.add_argument(
        '--version', action=_Version, nargs=0, const=package, help='print the version and exit'
    )
    return parser


def parse(
    package: str,
    parser: argparse.ArgumentParser,
    arguments: Sequence[str] | None = None,
    renamed: Mapping[str, str] | None = None,
) -> argparse.Namespace:
    """Parse the arguments of a command of `package`; complete them where a shell asks for it.

    renamed: earlier names of options; they are taken, and their user is told the name of today.
    """
    _with_version(package, parser)
    if '_ARGCOMPLETE' in os.environ:
        import argcomplete

        argcomplete.autocomplete(parser)
    given = sys.argv[1:] if arguments is None else arguments
    given = [_of_today(parser.prog, word, renamed or {}) for word in given]
    return parser.parse_args(with_negative_values(given))


def _of_today(program: str, word: str, renamed: Mapping[str, str]) -> str:
    """A word of a command line with the name that its option has now."""
    name, equals, value = word.partition('=')
    if name not in renamed:
        return word
    complain(program, f'{name} is called {renamed[name]} now')
    return renamed[name] + equals + value


def with_negative_values(arguments: Sequence[str]) -> list[str]:
    """Join an option with a following value that begins with a minus: `--contact -0.03,0,0`.

    argparse takes such a value for an option of its own.
    """
    joined: list[str] = []
    for word in arguments:
        if joined and re.match(r'-[.\d]', word) and re.fullmatch(r'--[a-z][-a-z]*', joined[-1]):
            joined[-1] = f'{joined[-1]}={word}'
        else:
            joined.append(word)
    return joined
